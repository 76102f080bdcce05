"""One reading, one contact wrench: mounting, payload and filter against known answers and the same in every use."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from crosspih_common.config import SensorSection, Workcell
from crosspih_common.geometry import Pose, transform_wrench
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import SetPayload
from crosspih_common.wrench import LowPass, Payload, SensorMounting

BIAS = np.array([0.8, -0.5, 1.2, 0.03, -0.02, 0.01])
WEIGHT = np.array([0.0, 0.0, -9.55])
CENTROID = np.array([0.001, 0.0, 0.033])


def any_mounting(rng: np.random.Generator) -> SensorMounting:
    axes = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], (3, 1))
    axes[0] *= np.sign(np.linalg.det(axes))
    pose = Pose(Rotation.random(rng=rng).as_matrix(), rng.normal(0.0, 0.05, 3))
    return SensorMounting(pose, int(rng.choice([-1, 1])), axes, float(rng.uniform(0.001, 5.0)), 0.113)


def raw_of(contact_peg: Array, rotation_base_peg: Array, payload: Payload) -> Array:
    """What a sensor reads of a contact, by the definition of each step."""
    mounting = payload.mounting
    pose = mounting.pose_peg_sensor
    sensor = transform_wrench(pose.inverse(), contact_peg)
    force = (rotation_base_peg @ pose.rotation).T @ payload.weight_base_n
    sensor = sensor + np.concatenate([force, np.cross(payload.centroid_sensor_m, force)]) + payload.bias
    force, moment = mounting.axes.T @ sensor[:3], mounting.axes.T @ sensor[3:]
    return mounting.sign * np.concatenate([force / mounting.n_per_unit, moment / mounting.nm_per_unit])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_only_the_contact_is_left_for_any_mounting_and_orientation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    payload = Payload(BIAS, WEIGHT, CENTROID, any_mounting(rng))
    rotations = Rotation.random(4, rng=rng).as_matrix()
    contacts = rng.normal(0.0, [10.0] * 3 + [1.0] * 3, (4, 6))
    raws = np.array([raw_of(*one, payload) for one in zip(contacts, rotations, strict=True)])
    assert payload.contact(raws, rotations) == pytest.approx(contacts, abs=1e-9)
    for raw, rotation, contact in zip(raws, rotations, contacts, strict=True):
        assert payload.contact(raw, rotation) == pytest.approx(contact, abs=1e-9)
        assert payload.mounting.raw(contact + payload.load(rotation)) == pytest.approx(raw, rel=1e-9, abs=1e-6)
        # the arm keeps the load while the orientation stays: the same number
        assert (payload.on_peg(raw) - payload.load(rotation)).tolist() == payload.contact(raw, rotation).tolist()
        tared = Payload.tare(raw, payload.mounting)
        assert tared.contact(raw, rotation) == pytest.approx(np.zeros(6), abs=1e-9)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    st.lists(st.floats(-0.05, 0.05), min_size=3, max_size=3), st.lists(st.floats(-0.002, 0.002), min_size=3, max_size=3)
)
def test_arm_and_service_have_the_same_number_for_a_turned_sensor(turn: list[float], shift: list[float]) -> None:
    workcell = Workcell.model_validate({"force_torque": {"correction": {"turn_rad": turn, "shift_m": shift}}})
    command = SetPayload(bias=tuple(BIAS), weight_n=9.55, centroid_ft_m=tuple(CENTROID), gravity_base=(0.0, 0.0, -2.0))
    arm = Payload.from_command(command, workcell.sensor_mounting())
    service = Payload(BIAS, WEIGHT, CENTROID, workcell.sensor_mounting())
    rng = np.random.default_rng(1)
    for rotation in Rotation.random(5, rng=rng).as_matrix():
        raw = raw_of(rng.normal(0.0, 5.0, 6), rotation, service)
        told = service.contact(raw[None], rotation)[0]
        assert arm.contact(raw, rotation) == pytest.approx(told, abs=1e-12)


def test_a_turn_that_the_arm_did_not_know_was_half_a_newton() -> None:
    turned = SensorMounting(Pose.from_rotvec([0.05, 0.0, 0.0], np.zeros(3)))
    payload, rotation = Payload(BIAS, WEIGHT, CENTROID, turned), Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix()
    raw = raw_of(np.zeros(6), rotation, payload)
    unaware = Payload(BIAS, WEIGHT, CENTROID).contact(raw, rotation)
    assert np.linalg.norm(unaware[:3]) == pytest.approx(2.0 * 9.55 * np.sin(0.025), abs=1e-9)
    assert payload.contact(raw, rotation) == pytest.approx(np.zeros(6), abs=1e-12)


def test_gravity_pulls_along_the_base_and_turns_about_the_centroid() -> None:
    payload = Payload(np.zeros(6), np.array([0.0, 0.0, -10.0]), np.array([0.0, 0.0, 0.05]))
    level = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # sensor x up, z forward
    assert payload.free_air(level) == pytest.approx([-10.0, 0.0, 0.0, 0.0, -0.5, 0.0])


def test_what_is_not_finite_is_refused() -> None:
    payload = Payload(BIAS, WEIGHT, CENTROID)
    for broken in (np.full(6, np.nan), np.array([0.0, np.inf, 0.0, 0.0, 0.0, 0.0]), np.full((3, 6), np.nan)):
        with pytest.raises(ValueError, match="not finite"):
            payload.contact(broken, np.eye(3))
    with pytest.raises(ValueError, match="weight_base_n"):
        Payload(BIAS, np.array([0.0, 0.0, np.nan]), CENTROID)
    command = SetPayload(bias=(0.0,) * 6, weight_n=1.0, centroid_ft_m=(0.0,) * 3, gravity_base=(0.0,) * 3)
    with pytest.raises(ValueError, match="gravity_base"):
        Payload.from_command(command)


@pytest.mark.parametrize(
    ("section", "raw", "peg"),
    [
        ({}, [1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6]),
        ({"reports": "reaction"}, [1, 2, 3, 4, 5, 6], [-1, -2, -3, -4, -5, -6]),
        ({"axes": ["-y", "x", "z"]}, [1, 2, 3, 4, 5, 6], [-2, 1, 3, -5, 4, 6]),
        ({"force_unit": "mN", "moment_unit": "Nmm"}, [1e3, 2e3, 3e3, 4e3, 5e3, 6e3], [1, 2, 3, 4, 5, 6]),
        ({"force_unit": "lbf", "moment_unit": "lbf_in"}, [1, 0, 0, 0, 1, 0], [4.4482216, 0, 0, 0, 0.11298483, 0]),
        # the sensor 40 mm behind the peg's frame, its x where the peg's y is
        (
            {"pose_flange_sensor": {"position_m": [0, 0, 0.0263], "rotvec_rad": [0, 0, pi / 2]}},
            [1, 0, 0, 0, 0, 0],
            [0, 1, 0, 0.04, 0, 0],
        ),
        ({"correction": {"shift_m": [0, 0, 0.01]}}, [1, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0.01, 0]),
    ],
)
def test_the_cells_file_says_how_to_read_a_sensor(
    section: dict[str, object], raw: list[float], peg: list[float]
) -> None:
    mounting = Workcell.model_validate({"force_torque": section}).sensor_mounting()
    assert np.array(raw, float) @ mounting.peg_of_raw.T == pytest.approx(peg, abs=1e-7)
    assert mounting.raw(peg) == pytest.approx(raw, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize(
    ("section", "what"),
    [
        ({"axes": ["x", "x", "z"]}, "each of x, y and z once"),
        ({"axes": ["x", "y", "-z"]}, "left-handed"),
        ({"force_unit": "pounds"}, "lbf"),
        ({"range_n": 0.0}, "greater than 0"),
    ],
)
def test_what_a_sensor_cannot_be_is_refused(section: dict[str, object], what: str) -> None:
    with pytest.raises(ValidationError, match=what):
        SensorSection.model_validate(section)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_the_pose_to_write_makes_a_turned_sensor_right(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = rng.uniform(-1.5, 1.5, 3)
    workcell = Workcell.model_validate(
        {"force_torque": {"correction": {"turn_rad": list(rng.uniform(-0.05, 0.05, 3))}}}
    )
    before = workcell.sensor_mounting().pose_peg_sensor
    mended = workcell.force_torque.turned(workcell.pose_flange_peg(), turn)
    section = workcell.force_torque.model_copy(update={"pose_flange_sensor": mended})
    after = section.mounting(workcell.pose_flange_peg()).pose_peg_sensor
    assert after.rotation == pytest.approx((before @ Pose.from_rotvec(turn, np.zeros(3))).rotation, abs=1e-9)
    assert after.translation_m == pytest.approx(before.translation_m, abs=1e-12)


def test_gravity_that_does_not_pull_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"9\.81"):
        Workcell(gravity_base_m_s2=(0.0, 0.0, 0.0))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    st.lists(st.integers(1, 12), min_size=1, max_size=8),
    st.floats(1.0, 400.0),
    st.sampled_from([0.008, 0.004, 0.001, 1 / 8000]),
)
def test_the_filter_is_one_however_its_samples_come(sizes: list[int], cutoff_hz: float, period_s: float) -> None:
    samples = np.random.default_rng(3).normal(size=(sum(sizes), 6))
    start = LowPass(cutoff_hz, period_s)
    gain = 1.0 - np.exp(-2.0 * np.pi * cutoff_hz * period_s)
    # a filter that stood still at the first sample, by scipy from the definition
    whole, _ = lfilter([gain], [1.0, gain - 1.0], samples, axis=0, zi=(1.0 - gain) * samples[:1])
    state, parts, at = start, [], 0
    for size in sizes:
        state, part = state.filtered(samples[at : at + size])
        parts.append(part)
        at += size
    assert np.concatenate(parts) == pytest.approx(whole, abs=1e-12)
    last = samples[0]
    for sample, filtered in zip(samples, whole, strict=True):
        last = start.next(last, sample)
        assert filtered == pytest.approx(last, abs=1e-12)


@pytest.mark.parametrize("rate_hz", [125, 250, 500, 1000, 8000])
def test_a_step_reaches_63_percent_after_one_time_constant(rate_hz: int) -> None:
    time_constant_s = 0.08
    state, _ = LowPass(1.0 / (2.0 * np.pi * time_constant_s), 0.001).at_period(1.0 / rate_hz).filtered(np.zeros((1, 6)))
    _, output = state.filtered(np.ones((round(time_constant_s * rate_hz), 6)))
    assert output[-1] == pytest.approx(np.full(6, 1.0 - np.exp(-1.0)), abs=1e-9)
    with pytest.raises(ValueError, match="cutoff_hz"):
        LowPass(0.0, 0.001)
