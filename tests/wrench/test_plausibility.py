"""A payload that hides a force is refused, one that fits is not: known cases and properties."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.wrench import Payload, PayloadLimits, SensorMounting, judge_payload

BIAS = np.array([0.8, -0.5, 1.2, 0.03, -0.02, 0.01])
WEIGHT = np.array([0.0, 0.0, -9.55])
CENTROID = np.array([0.001, 0.0, 0.033])
LIMITS = PayloadLimits()
SD = np.array([0.01] * 3 + [0.0005] * 3)
ROTATION = Rotation.from_rotvec([0.3, -0.8, 0.2]).as_matrix()


def at_rest(rotation: Array = ROTATION, mounting: SensorMounting | None = None) -> Array:
    true = Payload(BIAS, WEIGHT, CENTROID)
    mounting = SensorMounting() if mounting is None else mounting
    reading = true.free_air(mounting.rotation_base_sensor(rotation))
    return np.asarray(np.linalg.inv(mounting.sensor_of_raw) @ reading, dtype=float)


@pytest.mark.parametrize(
    ("payload", "what"),
    [
        (Payload(BIAS + np.array([-55.0, 0, 0, 0, 0, 0]), WEIGHT, CENTROID), "leaves 55.00 N .* of which bias"),
        (Payload(BIAS + np.array([0, 0, 0, 0, 1.0, 0]), WEIGHT, CENTROID), "1.000 Nm as contact"),
        (Payload(BIAS, np.zeros(3), np.zeros(3)), "leaves 9.55 N"),
        (Payload(BIAS, WEIGHT * 2.0, CENTROID), "leaves 9.55 N"),
        (Payload(BIAS, -WEIGHT, CENTROID), "180.0 degrees from cell.gravity_base_m_s2"),
        (Payload(BIAS, WEIGHT * 1000.0, CENTROID), "beyond the sensor's range .*force_unit"),
        (Payload(BIAS, WEIGHT, np.array([0.0, 0.0, 33.0])), "beyond the sensor's range"),
        (Payload(BIAS, WEIGHT, np.array([0.0, 0.0, 0.8])), "is it in metres"),
        (Payload(np.full(6, 1e4), WEIGHT, CENTROID), "bias: .* beyond the sensor's range"),
    ],
)
def test_what_does_not_fit_the_reading_at_rest_is_refused(payload: Payload, what: str) -> None:
    refusal = judge_payload(payload, at_rest(), SD, ROTATION, LIMITS)
    assert refusal is not None
    assert re.search(what, refusal), refusal


def test_a_sensor_that_shakes_or_says_nothing_is_no_witness() -> None:
    payload = Payload(BIAS, WEIGHT, CENTROID)
    refusal = judge_payload(payload, at_rest(), np.full(6, 3.0), ROTATION, LIMITS)
    assert refusal is not None and "does not rest" in refusal
    refusal = judge_payload(payload, np.full(6, np.nan), SD, ROTATION, LIMITS)
    assert refusal is not None and "not finite" in refusal


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.floats(0.5, 150.0), st.floats(0.0, 0.15))
def test_a_payload_within_its_own_accuracy_passes_and_a_hidden_force_never_does(
    seed: int, weight: float, tilt: float
) -> None:
    rng = np.random.default_rng(seed)
    mounting = SensorMounting(
        Pose(Rotation.random(rng=rng).as_matrix(), rng.normal(0.0, 0.05, 3)), int(rng.choice([-1, 1])), n_per_unit=0.001
    )
    down = Rotation.random(rng=rng).as_matrix()
    limits = PayloadLimits(down_base=tuple(9.81 * down[:, 2]))
    tilted = down @ Rotation.from_rotvec([tilt, 0.0, 0.0]).as_matrix()
    true = Payload(rng.normal(0.0, [20.0] * 3 + [1.0] * 3), weight * tilted[:, 2], rng.normal(0.0, 0.03, 3), mounting)
    rotation = Rotation.random(rng=rng).as_matrix()
    raw = mounting.raw(true.load(rotation))
    sd = np.array([10.0] * 3 + [0.0005] * 3)  # in mN
    off = Payload(true.bias, true.weight_base_n * 1.01, true.centroid_sensor_m, mounting)
    assert judge_payload(off, raw, sd, rotation, limits) is None
    hidden = rng.normal(size=3)
    hidden *= (1.1 * max(2.0, 0.05 * weight) + 0.1) / np.linalg.norm(hidden)
    wrong = Payload(
        true.bias + np.concatenate([hidden, np.zeros(3)]), true.weight_base_n, true.centroid_sensor_m, mounting
    )
    assert judge_payload(wrong, raw, sd, rotation, limits) is not None
