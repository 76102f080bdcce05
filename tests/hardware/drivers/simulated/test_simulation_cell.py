"""The simulated cell without contact: weight, time, trials, refusals, stop."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest

from crosspih_common.arm.inverse import nearest
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose, wrench_of_force_at_point
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import (
    AdmittanceMove,
    CaptureStereo,
    Dwell,
    FollowTrajectory,
    GuardedMove,
    JointKnot,
    JointState,
    MoveLinear,
    RawWrenchBatch,
    ResetCell,
    StopReason,
)
from crosspih_common.messages.base import PoseData, floats
from services.hardware.config import HardwareConfig
from services.hardware.drivers.simulated.config import SimulatedConfig, SimulatedSensorConfig
from services.hardware.hosting import HostedCell, open_cell
from tests.hardware.drivers.simulated.payload import know_payload

WORKCELL = Workcell()
FT = SimulatedSensorConfig()
QUIET = HardwareConfig(simulated=SimulatedConfig(force_torque=SimulatedSensorConfig(noise_n=0.0, noise_nm=0.0)))
HOME = np.array(WORKCELL.home_joints_rad)


def moved(by: list[float]) -> Array:
    return np.asarray(HOME + np.array(by, dtype=float))


@pytest.fixture
def cell() -> Iterator[HostedCell]:
    opened = open_cell(WORKCELL, HardwareConfig(), realtime=False)
    yield opened
    opened.close()


def knots(*joints: object, seconds: float = 1.0) -> tuple[JointKnot, ...]:
    return tuple(
        JointKnot(time_s=index * seconds, joints_rad=floats(np.asarray(j, float))) for index, j in enumerate(joints)
    )


def test_it_is_a_cell(cell: HostedCell) -> None:
    assert cell.has_arm and cell.has_camera and cell.has_simulation
    assert cell.arm.now_ns() == 0


def test_the_sensor_reads_bias_and_weight_exactly() -> None:
    cell = open_cell(WORKCELL, QUIET, realtime=False)
    try:
        for joints in ([0.3, -0.4, 0.5, 0.9, -0.6, 1.2], [-0.8, 0.6, -0.3, -1.1, 0.9, -2.0]):
            cell.simulation.reset(
                ResetCell(
                    seed=1,
                    offset_hole=(0.0,) * 6,
                    place_peg=PoseData.of(
                        WORKCELL.hole_prior.pose_base_hole().inverse() @ WORKCELL.pose_base_peg(tuple(joints))
                    ),
                )
            )
            outcome = cell.arm.dwell(Dwell(duration_s=0.1))
            down = outcome.pose_base_peg.pose().rotation.T @ np.array([0.0, 0.0, -9.81 * FT.payload_kg])
            expected = np.array(FT.bias) + wrench_of_force_at_point(down, FT.payload_centroid_m)
            np.testing.assert_allclose(outcome.wrench_raw, expected, atol=1e-6)
    finally:
        cell.close()


def test_noise_has_the_size_it_is_said_to_have(cell: HostedCell) -> None:
    batches: list[RawWrenchBatch] = []
    cell.arm.on_batch(batches.append)
    outcome = cell.arm.dwell(Dwell(duration_s=1.0))
    samples = np.array([sample for batch in batches for sample in batch.samples])
    np.testing.assert_allclose(samples.std(axis=0), [0.1] * 3 + [0.005] * 3, rtol=0.12)
    np.testing.assert_allclose(outcome.wrench_sd, [0.1 / 970**0.5] * 3 + [0.005 / 970**0.5] * 3, rtol=0.12)


def test_streams_keep_their_rates_and_the_clock_stands_still_between_commands(cell: HostedCell) -> None:
    states: list[JointState] = []
    batches: list[RawWrenchBatch] = []
    ticks: list[int] = []
    cell.arm.on_joint_state(states.append)
    cell.arm.on_batch(batches.append)
    cell.arm.on_tick(ticks.append)
    cell.arm.dwell(Dwell(duration_s=0.2))
    assert cell.arm.now_ns() == 200_000_000
    assert len(states) == 50
    assert [batch.stamp_ns for batch in batches] == [1_000_000 + 10_000_000 * k for k in range(20)]
    assert all(len(batch.samples) == 10 for batch in batches)
    assert ticks == [20_000_000 * k for k in range(1, 11)]


def test_follow_ends_where_it_should_and_says_how_long_it_took(cell: HostedCell) -> None:
    goal = moved([0.3, 0.2, -0.2, 0.4, -0.3, 0.5])
    outcome = cell.arm.follow(FollowTrajectory(knots=knots(HOME, goal)))
    assert outcome.stop_reason is StopReason.COMPLETED
    np.testing.assert_allclose(outcome.joints_rad, goal, atol=1e-12)
    assert outcome.duration_s == pytest.approx(1.03)
    assert cell.arm.joint_state().joints_rad == pytest.approx(outcome.joints_rad, abs=1e-9)
    # in free air nothing bends: the link side is where the motor side is
    truth = cell.simulation.truth().pose_base_peg.pose()
    assert truth.distance_to_m(outcome.pose_base_peg.pose()) < 1e-5


def test_linear_moves_go_straight(cell: HostedCell) -> None:
    start = WORKCELL.pose_base_peg(WORKCELL.home_joints_rad)
    goal = start @ Pose.from_rotvec([0.1, -0.05, 0.1], [0.02, -0.03, 0.04])
    outcome = cell.arm.move_linear(MoveLinear(pose_base_peg=PoseData.of(goal)))
    assert outcome.stop_reason is StopReason.COMPLETED
    assert outcome.pose_base_peg.pose().distance_to_m(goal) < 1e-9
    assert outcome.pose_base_peg.pose().angle_to_rad(goal) < 1e-7
    assert outcome.travel_m == pytest.approx(start.distance_to_m(goal))


@pytest.mark.parametrize(
    ("trajectory", "code", "words"),
    [
        (knots(HOME + 0.02, HOME), "wrong_start", "joint 1"),
        (knots(HOME, moved([0, 2.5, 0, 0, 0, 0]), seconds=5.0), "joint_limit", "joint 2"),
        (knots(HOME, moved([0, 0, 0, 1.5, 0, 0]), seconds=0.3), "speed_limit", "joint 4"),
        (knots(HOME, moved([0.1, 0, 0, 0, 0, 0]), seconds=0.05), "acceleration_limit", "joint 1"),
        (knots(HOME, HOME, seconds=0.0), "knots", "times"),
    ],
)
def test_trajectories_are_refused_before_anything_moves(
    cell: HostedCell, trajectory: tuple[JointKnot, ...], code: str, words: str
) -> None:
    with pytest.raises(CommandRefused) as refusal:
        cell.arm.follow(FollowTrajectory(knots=trajectory))
    assert refusal.value.code == code
    assert words in refusal.value.text
    assert cell.arm.now_ns() == 0


def test_unreachable_and_nan_and_directionless_commands_are_refused(cell: HostedCell) -> None:
    far = Pose.from_translation([2.0, 0.0, 0.3])
    with pytest.raises(CommandRefused, match="unreachable"):
        cell.arm.move_linear(MoveLinear(pose_base_peg=PoseData.of(far)))
    nan = GuardedMove.model_construct(direction_base=(float("nan"), 0.0, 0.0), speed_m_s=0.01, travel_limit_m=0.01)
    with pytest.raises(CommandRefused, match="not_finite"):
        cell.arm.guarded_move(nan)
    with pytest.raises(CommandRefused, match="direction"):
        # the bus would not take it
        cell.arm.admittance_move(
            AdmittanceMove.model_construct(direction_base=(0.0, 0.0, 0.0), speed_m_s=0.01, travel_m=0.01)
        )
    with pytest.raises(CommandRefused, match="unreachable"):
        cell.arm.guarded_move(GuardedMove(direction_base=(0.0, -1.0, 0.0), speed_m_s=0.05, travel_limit_m=0.3))
    assert cell.arm.now_ns() == 0


def test_a_guarded_move_in_free_air_reaches_its_limit(cell: HostedCell) -> None:
    know_payload(cell, FT)
    outcome = cell.arm.guarded_move(GuardedMove(direction_base=(0.0, 0.0, -2.0), speed_m_s=0.05, travel_limit_m=0.02))
    assert outcome.stop_reason is StopReason.TRAVEL_LIMIT
    assert outcome.travel_m == pytest.approx(0.02, abs=2e-6)
    assert outcome.travel_first_contact_m is None
    assert outcome.wrench_observed_raw is None
    assert outcome.wrench_free_raw is not None


def test_stop_from_another_thread_ends_a_motion_within_the_braking_time(cell: HostedCell) -> None:
    stopped_at: list[int] = []

    def stop_at(now_ns: int) -> None:
        if now_ns == 300_000_000:
            caller = threading.Thread(target=lambda: stopped_at.append(now_ns if cell.arm.stop() else -1))
            caller.start()
            caller.join()

    cell.arm.on_tick(stop_at)
    goal = moved([-0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    outcome = cell.arm.follow(FollowTrajectory(knots=knots(HOME, goal)))
    assert stopped_at == [300_000_000]
    assert outcome.stop_reason is StopReason.STOPPED
    assert outcome.duration_s < 0.35
    assert HOME[0] > outcome.joints_rad[0] > goal[0]
    assert not cell.arm.stop()
    again = cell.arm.follow(FollowTrajectory(knots=knots(outcome.joints_rad, HOME)))
    assert again.stop_reason is StopReason.COMPLETED


def test_only_one_command_at_a_time(cell: HostedCell) -> None:
    codes: list[str] = []

    def meanwhile(now_ns: int) -> None:
        try:
            cell.arm.dwell(Dwell(duration_s=0.01))
        except CommandRefused as refusal:
            codes.append(refusal.code)

    cell.arm.on_tick(meanwhile)
    cell.arm.dwell(Dwell(duration_s=0.02))
    assert codes == ["busy"]


def test_holes_are_drawn_inside_their_ranges_and_by_their_seed(cell: HostedCell) -> None:
    half = WORKCELL.hole_prior.half_ranges()
    nominal = WORKCELL.hole_prior.pose_base_hole()
    offsets = []
    for seed in range(40):
        truth = cell.simulation.reset(ResetCell(seed=seed))
        assert truth.seed == seed
        offset = nominal.inverse() @ truth.pose_base_hole.pose()
        offsets.append([*offset.translation_m, *offset.rotvec_rad()])
        assert np.all(np.abs(offsets[-1]) <= half + 1e-9)
    spread = np.array(offsets).std(axis=0)
    np.testing.assert_allclose(spread, half / 3**0.5, rtol=0.4)
    again = nominal.inverse() @ cell.simulation.reset(ResetCell(seed=7)).pose_base_hole.pose()
    np.testing.assert_array_equal([*again.translation_m, *again.rotvec_rad()], offsets[7])


def test_reset_places_the_peg_and_refuses_to_place_it_inside_the_fixture(cell: HostedCell) -> None:
    place = Pose.from_rotvec([0.02, 0.03, -0.04], [0.001, 0.002, -0.09])
    truth = cell.simulation.reset(ResetCell(seed=1, place_peg=PoseData.of(place)))
    placed = truth.pose_base_hole.pose().inverse() @ truth.pose_base_peg.pose()
    assert placed.distance_to_m(place) < 1e-9
    before = cell.arm.joint_state()
    with pytest.raises(CommandRefused, match="peg_in_contact"):
        cell.simulation.reset(ResetCell(seed=1, place_peg=PoseData.of(Pose.from_translation([0.02, 0.02, -0.07]))))
    assert cell.arm.joint_state() == before
    assert cell.simulation.truth().pose_base_hole == truth.pose_base_hole


def test_compensation_uses_the_payload_it_is_given(cell: HostedCell) -> None:
    goal = nearest(WORKCELL.arm(), WORKCELL.arm().pose_base_flange(HOME + 0.25), HOME)
    without = cell.arm.follow(FollowTrajectory(knots=knots(HOME, goal, seconds=3.0)))
    know_payload(cell, FT)
    known = cell.arm.follow(FollowTrajectory(knots=knots(goal, HOME, seconds=3.0)))
    assert known.peak_force_n < 1.5 < without.peak_force_n


def test_realtime_keeps_the_clock_running_between_commands() -> None:
    cell = open_cell(WORKCELL, HardwareConfig(), realtime=True)
    try:
        ticked = threading.Event()
        cell.arm.on_tick(lambda now_ns: ticked.set() if now_ns >= 60_000_000 else None)
        assert ticked.wait(timeout=20.0)
        outcome = cell.arm.dwell(Dwell(duration_s=0.05))
        assert outcome.stop_reason is StopReason.COMPLETED
        assert cell.arm.now_ns() >= outcome.start_stamp_ns + 50_000_000
    finally:
        cell.close()


def test_a_capture_takes_its_exposure_and_shows_the_hole(cell: HostedCell) -> None:
    cell.simulation.reset(ResetCell(seed=5))
    taken = cell.camera.capture(CaptureStereo())
    left, right = taken.left, taken.right
    assert (taken.stamp_ns, taken.exposure_s) == (0, 0.02)
    assert cell.arm.now_ns() == 20_000_000
    assert left.shape == right.shape == (480, 640)
    assert left.std() > 10.0
    cell.simulation.reset(ResetCell(seed=5))
    np.testing.assert_array_equal(left, cell.camera.capture(CaptureStereo()).left)
