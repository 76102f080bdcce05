"""The simulated cell in contact: touches against exact geometry, deflection, caps, insertion, determinism."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose, wrench_of_force_at_point
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import (
    AdmittanceMove,
    GuardedMove,
    GuardedMoveOutcome,
    MoveLinear,
    ResetCell,
    StopReason,
)
from crosspih_common.messages.base import PoseData, floats
from services.hardware.config import HardwareConfig
from services.hardware.control.guarded import onset
from services.hardware.drivers.simulated.config import SimulatedConfig, SimulatedSensorConfig
from services.hardware.hosting import HostedCell, open_cell
from tests.hardware.drivers.simulated.payload import know_payload

WORKCELL = Workcell()
PEG = WORKCELL.peg.shape()
HOLE = WORKCELL.hole.shape(PEG)
HALF_WIDTH_M = WORKCELL.peg.half_width_m + WORKCELL.hole.clearance_m
SLOPE = WORKCELL.peg.taper_slope
NOMINAL = WORKCELL.hole_prior.pose_base_hole()
AXIS_BASE = NOMINAL.rotation[:, 2]
FT = SimulatedSensorConfig()


def opened(friction: float = 0.1, noisy: bool = True, **more: Any) -> HostedCell:
    sensor = FT if noisy else SimulatedSensorConfig(noise_n=0.0, noise_nm=0.0)
    config = SimulatedConfig(friction_coefficient=friction, force_torque=sensor, **more)
    cell = open_cell(WORKCELL, HardwareConfig(simulated=config), realtime=False)
    know_payload(cell, FT)
    return cell


@pytest.fixture
def cell() -> Iterator[HostedCell]:
    made = opened()
    yield made
    made.close()


def place(cell: HostedCell, lateral_m: tuple[float, float], before_m: float, seed: int = 0) -> None:
    """The peg aligned with the nominal hole, its tip before the face."""
    pose = Pose.from_translation([*lateral_m, -PEG.tip_m - before_m])
    cell.simulation.reset(ResetCell(seed=seed, offset_hole=(0.0,) * 6, place_peg=PoseData.of(pose)))


def contact_of(outcome: GuardedMoveOutcome) -> Array:
    """The observed wrench without bias and weight."""
    assert outcome.pose_base_peg_observed is not None
    down = outcome.pose_base_peg_observed.pose().rotation.T @ np.array([0.0, 0.0, -9.81 * FT.payload_kg])
    weight = wrench_of_force_at_point(down, FT.payload_centroid_m)
    return np.asarray(np.array(outcome.wrench_observed_raw) - FT.bias - weight)


def touch(cell: HostedCell, **more: Any) -> GuardedMoveOutcome:
    command = {"speed_m_s": 0.005, "travel_limit_m": 0.04, "observe_s": 0.1, **more}
    return cell.arm.guarded_move(GuardedMove(direction_base=floats(AXIS_BASE), **command))


def test_the_face_is_felt_where_it_is(cell: HostedCell) -> None:
    place(cell, (0.02, 0.02), 0.004)
    outcome = touch(cell, retreat_m=0.001)
    assert outcome.stop_reason is StopReason.CONTACT
    assert outcome.travel_first_contact_m == pytest.approx(0.004, abs=1e-5)
    assert outcome.travel_m > 0.004
    assert outcome.peak_force_n < 40.0
    start = NOMINAL @ Pose.from_translation([0.02, 0.02, -PEG.tip_m - 0.004])
    assert outcome.pose_base_peg.pose().distance_to_m(start) == pytest.approx(outcome.travel_m + 1e-4 - 0.001, abs=2e-4)


def test_a_wall_is_felt_where_the_drawing_says_and_pushes_along_its_normal() -> None:
    """1 mm off along x, aligned and without friction: both y arms meet the inner rim with their tapered sides.

    They do where half-width plus offset is the hole's: at slope (apex - z) + offset = half-width of the hole.
    """
    cell = opened(friction=0.0, noisy=False)
    try:
        place(cell, (0.001, 0.0), 0.004)
        z_m = PEG.apex_m - (HALF_WIDTH_M - 0.001) / SLOPE
        travel_m = HOLE.chamfer_m - z_m + PEG.tip_m + 0.004
        outcome = touch(cell)
        assert outcome.stop_reason is StopReason.CONTACT
        assert outcome.travel_first_contact_m == pytest.approx(travel_m, abs=2e-5)
        wrench = contact_of(outcome)
        normal = np.array([-1.0, 0.0, -SLOPE])
        cosine = wrench[:3] @ normal / np.linalg.norm(wrench[:3]) / np.linalg.norm(normal)
        assert np.degrees(np.arccos(min(1.0, cosine))) < 0.3
        # the force goes through the touching rim: My = z Fx - x Fz
        assert wrench[4] == pytest.approx(z_m * wrench[0] + 0.0081 * -wrench[2], abs=0.02)
    finally:
        cell.close()


@pytest.mark.parametrize("stiffness_n_m", [2e4, 1e5, 4e5])
def test_the_onset_is_found_in_noise_behind_the_threshold(stiffness_n_m: float) -> None:
    errors = []
    for seed in range(50):
        rng = np.random.default_rng(seed)
        touched_m = 0.002 + rng.uniform(0.0, 5e-6)
        travels = np.arange(1, 1000) * 5e-6
        forces = np.maximum(0.0, travels - touched_m) * stiffness_n_m
        count = int(np.argmax(forces > 5.0)) + 1
        contacts: Array = rng.normal(size=(count, 6)) * [0.1, 0.1, 0.1, 0.005, 0.005, 0.005]
        contacts[:, :3] += forces[:count, None] * np.array([0.8, 0.0, -0.6])
        errors.append(onset(np.asarray(travels[:count], dtype=float), contacts, 0.001) - touched_m)
    assert np.max(np.abs(errors)) < 3e-5
    assert abs(float(np.median(errors))) < 5e-6


def test_deflection_is_what_the_stiffness_says() -> None:
    cell = opened(friction=0.0, noisy=False)
    try:
        place(cell, (0.001, 0.0), 0.004)
        outcome = touch(cell)
        truth = cell.simulation.truth()
        assert outcome.joints_observed_rad is not None
        bend = WORKCELL.compliance_peg(outcome.joints_observed_rad) @ np.array(truth.wrench_contact)
        motor, link = outcome.pose_base_peg.pose(), truth.pose_base_peg.pose()
        real = motor.inverse() @ link
        assert np.linalg.norm(bend[:3]) > 5e-5
        np.testing.assert_allclose(real.translation_m, bend[:3], atol=0.1 * float(np.linalg.norm(bend[:3])))
        np.testing.assert_allclose(real.rotvec_rad(), bend[3:], atol=0.1 * float(np.linalg.norm(bend[3:])))
    finally:
        cell.close()


def test_contacts_in_the_truth_add_up_to_what_the_sensor_feels(cell: HostedCell) -> None:
    place(cell, (0.001, 0.0005), 0.004)
    outcome = touch(cell)
    truth = cell.simulation.truth()
    assert truth.contacts
    total = np.sum([contact.force_base_n for contact in truth.contacts], axis=0)
    into_peg = truth.pose_base_peg.pose().rotation.T
    np.testing.assert_allclose(into_peg @ total, truth.wrench_contact[:3], atol=1e-9)
    np.testing.assert_allclose(contact_of(outcome), truth.wrench_contact, atol=1.0)


def test_pushing_into_the_face_trips_the_force_cap_and_backs_off(cell: HostedCell) -> None:
    place(cell, (0.02, 0.02), 0.001)
    goal = NOMINAL @ Pose.from_translation([0.02, 0.02, -PEG.tip_m + 0.006])
    outcome = cell.arm.move_linear(MoveLinear(pose_base_peg=PoseData.of(goal), speed_m_s=0.005))
    assert outcome.stop_reason is StopReason.FORCE_CAP
    assert "60 N" in outcome.detail
    assert 45.0 < outcome.peak_force_n < 66.0  # it reacts before the cap, by what its speed will still press
    assert np.linalg.norm(cell.simulation.truth().wrench_contact[:3]) < 6.0
    assert outcome.pose_base_peg.pose().distance_to_m(goal) > 0.005


def test_turning_in_the_hole_trips_the_moment_cap_and_backs_off(cell: HostedCell) -> None:
    # the body 5 mm deep
    before_m = -PEG.tip_m + PEG.taper_start_m - HOLE.chamfer_m - 0.005
    place(cell, (0.0, 0.0), before_m)
    start = NOMINAL @ Pose.from_translation([0.0, 0.0, -PEG.tip_m - before_m])
    goal = start @ Pose.from_rotvec([0.0, 0.0, 0.05], [0.0, 0.0, 0.0])
    outcome = cell.arm.move_linear(MoveLinear(pose_base_peg=PoseData.of(goal), rotational_speed_rad_s=0.1))
    assert outcome.stop_reason is StopReason.MOMENT_CAP
    assert outcome.peak_moment_nm < 7.5
    assert np.linalg.norm(cell.simulation.truth().wrench_contact[3:]) < 1.0


def test_an_aligned_peg_slides_in_and_sits(cell: HostedCell) -> None:
    place(cell, (0.0, 0.0), 0.001)
    outcome = cell.arm.admittance_move(
        AdmittanceMove(direction_base=floats(AXIS_BASE), speed_m_s=0.02, travel_m=0.043, timeout_s=10.0)
    )
    assert outcome.stop_reason is StopReason.SEATED
    assert outcome.peak_force_n < 2.0
    depth_m = (NOMINAL.inverse() @ cell.simulation.truth().pose_base_peg.pose()).translation_m[2]
    assert depth_m + PEG.taper_start_m - HOLE.chamfer_m > WORKCELL.insertion_depth_m


def test_small_errors_are_yielded_to_under_the_caps(cell: HostedCell) -> None:
    pose = Pose.from_rotvec([0.006, -0.006, 0.006], [0.0004, -0.0004, -PEG.tip_m - 0.001])
    cell.simulation.reset(ResetCell(seed=3, offset_hole=(0.0,) * 6, place_peg=PoseData.of(pose)))
    outcome = cell.arm.admittance_move(
        AdmittanceMove(direction_base=floats(AXIS_BASE), speed_m_s=0.01, travel_m=0.043, timeout_s=10.0)
    )
    assert outcome.stop_reason is StopReason.SEATED
    assert outcome.peak_force_n < 30.0


def test_an_admittance_move_against_the_face_stalls_under_its_axial_force(cell: HostedCell) -> None:
    place(cell, (0.02, 0.02), 0.0005)
    outcome = cell.arm.admittance_move(
        AdmittanceMove(direction_base=floats(AXIS_BASE), speed_m_s=0.004, travel_m=0.02, axial_force_n=15.0)
    )
    assert outcome.stop_reason is StopReason.STALLED
    assert np.linalg.norm(cell.simulation.truth().wrench_contact[:3]) < 16.0
    assert outcome.travel_m < 0.002


def test_the_same_seed_and_commands_give_the_same_trial_to_the_last_bit() -> None:
    def trial(cell: HostedCell) -> list[dict[str, Any]]:
        pose = Pose.from_rotvec([0.02, 0.03, 0.04], [0.002, 0.001, -PEG.tip_m - 0.002])
        cell.simulation.reset(ResetCell(seed=11, place_peg=PoseData.of(pose)))
        axis = cell.simulation.truth().pose_base_peg.pose().rotation[:, 2]
        one = cell.arm.guarded_move(
            GuardedMove(direction_base=floats(axis), speed_m_s=0.01, travel_limit_m=0.03, retreat_m=0.001)
        )
        two = cell.arm.admittance_move(
            AdmittanceMove(direction_base=floats(axis), speed_m_s=0.01, travel_m=0.02, timeout_s=0.5)
        )
        results = [one.model_dump(), two.model_dump(), cell.simulation.truth().model_dump()]
        for result in results:
            # time goes on from trial to trial
            for key in ("stamp_ns", "start_stamp_ns", "duration_s"):
                result.pop(key, None)
        return results

    first = opened()
    try:
        once = trial(first)
        touch(first)
        assert trial(first) == once
    finally:
        first.close()
    second = opened()
    try:
        assert trial(second) == once
    finally:
        second.close()


def test_no_move_goes_by_force_before_the_payload_is_known() -> None:
    cell = open_cell(WORKCELL, HardwareConfig(), realtime=False)
    try:
        place(cell, (0.02, 0.02), 0.002)
        into = cell.arm.joint_state()
        presses: tuple[Callable[[], object], ...] = (
            lambda: touch(cell),
            lambda: cell.arm.admittance_move(
                AdmittanceMove(direction_base=floats(AXIS_BASE), speed_m_s=0.02, travel_m=0.02)
            ),
        )
        for press in presses:
            with pytest.raises(CommandRefused, match="crosspih calibrate ft") as refusal:
                press()
            assert refusal.value.code == "no_payload"
        assert cell.arm.joint_state() == into
        know_payload(cell, FT)
        assert touch(cell, retreat_m=0.002).stop_reason is StopReason.CONTACT
    finally:
        cell.close()
