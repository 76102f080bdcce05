"""The judging of `crosspih cell check`: known answers, and what must hold whatever the numbers are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from crosspih_common.config import Workcell
from crosspih_common.config.force_torque import FORCE_UNITS
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import (
    CameraCalibration,
    CameraModel,
    CellClock,
    Image,
    JointState,
    MotionOutcome,
    PoseData,
    RawWrenchBatch,
    StereoPair,
    StopReason,
)
from services.operator.cell.check import gravity, images, presence, streams
from services.operator.cell.check.gravity import DwellReading, felt_weight
from services.operator.cell.check.measuring import tilt_axes
from services.operator.cell.check.provoking import beyond
from services.operator.cell.check.refused import CommandEnd, check_refused, check_stop
from services.operator.cli.rows import Row, Verdict

WORKCELL = Workcell()
TILTS = ((0.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3))
SECOND = 1_000_000_000


def workcell(**sensor: Any) -> Workcell:
    return Workcell.model_validate({"force_torque": sensor})


def readings(peg: Array, weight_n: float, turn_rad: Any = (0.0, 0.0, 0.0), sign: int = 1, scale: float = 1.0,
             cell: Workcell = WORKCELL, bias: Any = (0.0,) * 6) -> list[DwellReading]:  # fmt: skip
    """What a sensor would give that is turned, reversed or scaled against what the file of WORKCELL says."""
    down = np.asarray(cell.gravity_base_m_s2) / np.linalg.norm(cell.gravity_base_m_s2)
    real = Rotation.from_rotvec(turn_rad).as_matrix()
    pitch, roll = tilt_axes(peg, down)
    found = []
    for one, two in TILTS:
        tilted = Rotation.from_rotvec(one * pitch + two * roll).as_matrix() @ peg
        force = weight_n * (tilted @ real).T @ down
        moment = np.cross([0.0, 0.0, 0.03], force)
        raw = sign * scale * np.concatenate([force, moment]) + np.asarray(bias)
        found.append(DwellReading(tilted, raw, np.full(6, 1e-3)))
    return found


rotations = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(lambda turn: Rotation.from_rotvec(turn).as_matrix())
turns = st.tuples(*[st.floats(-1.7, 1.7)] * 3)
biases = st.tuples(*[st.floats(-5.0, 5.0)] * 6)


@given(rotations, turns, st.sampled_from([1, -1]), st.floats(1.0, 60.0), biases)
def test_sign_turn_and_weight_are_found_whatever_the_bias(
    peg: Array, turn: tuple[float, ...], sign: int, weight_n: float, bias: tuple[float, ...]
) -> None:
    felt = felt_weight(readings(peg, weight_n, turn, sign, bias=bias), WORKCELL)
    assert felt is not None
    assert felt.sign == sign and felt.weight_n == pytest.approx(weight_n, rel=1e-6) and felt.residual < 1e-6
    off = Rotation.from_rotvec(felt.turn_rad).inv() * Rotation.from_rotvec(turn)
    assert off.magnitude() < 1e-4
    assert felt.lever_m <= 0.03 + 1e-9


@given(rotations, st.sampled_from(list(Rotation.create_group("O"))), st.sampled_from([1, -1]))
def test_a_sensor_at_right_angles_is_mended_by_what_the_mend_says(peg: Array, turn: Rotation, sign: int) -> None:
    """The settings of the mend, put into the cell's file, let the same raw numbers pass."""
    measured = readings(peg, 9.5, turn.as_rotvec(), sign)
    check = gravity.check_sign(felt_weight(measured, WORKCELL), WORKCELL)
    wrong = turn.magnitude() > 0.1 or sign < 0
    assert (check.verdict is Verdict.WRONG) == wrong
    if not wrong:
        return
    settings: dict[str, Any] = {}
    for part in check.mend.split("; "):
        name, _, value = part.removeprefix("cell.force_torque.").partition(": ")
        if name == "axes":
            settings[name] = value.strip("[]").split(", ")
        if name == "reports":
            settings[name] = value
    mended = workcell(**settings)
    assert gravity.check_sign(felt_weight(measured, mended), mended).verdict is Verdict.OK, check


def test_a_sensor_turned_askew_is_mended_by_its_mounting() -> None:
    peg = WORKCELL.pose_base_peg(WORKCELL.home_joints_rad).rotation
    turn = np.array([0.1, -0.2, 0.5])
    measured = readings(peg, 9.5, turn)
    check = gravity.check_sign(felt_weight(measured, WORKCELL), WORKCELL)
    assert check.verdict is Verdict.WRONG and "pose_flange_sensor" in check.mend
    inside = check.mend.partition("rotvec_rad: [")[2].partition("]")[0]
    rotvec = [float(value) for value in inside.split(", ")]
    mended = workcell(pose_flange_sensor={"position_m": [0.0, 0.0, 0.0663], "rotvec_rad": rotvec})
    assert gravity.check_sign(felt_weight(measured, mended), mended).verdict is Verdict.OK


@given(st.sampled_from(sorted(FORCE_UNITS)), st.floats(2.0, 60.0), rotations)
def test_the_unit_is_named_where_the_weight_is_known(unit: str, weight_n: float, peg: Array) -> None:
    felt = felt_weight(readings(peg, weight_n, scale=1.0 / FORCE_UNITS[unit]), WORKCELL)
    check = gravity.check_unit(felt, WORKCELL, weight_n, "scales")
    assert (check.verdict is Verdict.OK) == (unit == "N")
    if unit != "N":
        assert f"force_unit: {unit}" in check.mend


def test_an_unknown_weight_that_cannot_be_is_named() -> None:
    peg = WORKCELL.pose_base_peg(WORKCELL.home_joints_rad).rotation
    heavy = gravity.check_unit(felt_weight(readings(peg, 9557.0), WORKCELL), WORKCELL, None, "")
    assert heavy.verdict is Verdict.WRONG and "mN" in heavy.mend
    light = gravity.check_unit(felt_weight(readings(peg, 0.0096), WORKCELL), WORKCELL, None, "")
    assert light.verdict is Verdict.WRONG and "kN" in light.mend
    assert gravity.check_unit(felt_weight(readings(peg, 9.6), WORKCELL), WORKCELL, None, "").verdict is Verdict.OK


def test_a_force_that_is_no_turned_weight_is_no_sound_sensor() -> None:
    peg = WORKCELL.pose_base_peg(WORKCELL.home_joints_rad).rotation
    pulled = [
        DwellReading(one.rotation_base_peg, one.raw + np.array([(-1.0) ** index * 3.0, 0, 0, 0, 0, 0]), one.raw_sd)
        for index, one in enumerate(readings(peg, 9.5))
    ]
    check = gravity.check_sign(felt_weight(pulled, WORKCELL), WORKCELL)
    assert check.verdict is Verdict.WRONG and "cable" in check.mend
    dead = [DwellReading(one.rotation_base_peg, np.zeros(6), one.raw_sd) for one in pulled]
    assert gravity.check_sign(felt_weight(dead, WORKCELL), WORKCELL).verdict is Verdict.WRONG
    assert felt_weight(readings(peg, 9.5)[:2], WORKCELL) is None
    assert gravity.check_sign(None, WORKCELL).verdict is Verdict.SKIPPED


def test_moments_in_mnm_hang_the_weight_far_away() -> None:
    peg = WORKCELL.pose_base_peg(WORKCELL.home_joints_rad).rotation
    big = [
        DwellReading(one.rotation_base_peg, one.raw * np.array([1, 1, 1, 1e3, 1e3, 1e3]), one.raw_sd)
        for one in readings(peg, 9.5)
    ]
    check = gravity.check_moment(felt_weight(big, WORKCELL))
    assert check.verdict is Verdict.WRONG and "moment_unit" in check.mend


@given(rotations)
def test_tilt_axes_are_level_and_at_right_angles(peg: Array) -> None:
    down = np.array([0.0, 0.0, -9.81])
    pitch, roll = tilt_axes(peg, down)
    frame = np.array([pitch, roll, down / 9.81])
    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-9)


# ------------------------------------------------------------------------------------------------------------- streams


def states(factor: float = 1.0, count: int = 100, scale: float = 1.0) -> list[JointState]:
    """A swing of all joints, its told speeds multiplied by `factor` and positions by `scale`."""
    times = np.arange(count) * 0.004
    return [
        JointState(
            stamp_ns=round(at * 1e9),
            joints_rad=tuple(scale * 0.2 * (1 - np.cos(at * (2 + joint))) for joint in range(6)),
            speeds_rad_s=tuple(factor * 0.2 * (2 + joint) * np.sin(at * (2 + joint)) for joint in range(6)),
        )
        for at in times
    ]


@pytest.mark.parametrize(
    ("factor", "said"),
    [(1.0, None), (streams.DEGREES, "degrees a second"), (0.0, "zero"), (-1.0, "-1 times"), (2.0, "2 times")],
)
def test_speeds_against_positions(factor: float, said: str | None) -> None:
    check = streams.check_speeds(states(factor))
    assert (check.verdict is Verdict.OK) == (said is None)
    assert said is None or said in check.found


def test_encoders_that_stand_still_are_not_believed() -> None:
    assert "stood still" in streams.check_speeds(states(scale=0.0)).found
    assert streams.check_speeds(states()[:3]).verdict is Verdict.WRONG


@given(st.lists(st.floats(-6.0, 6.0), min_size=6, max_size=6))
def test_degrees_are_told_from_radians(joints: list[float]) -> None:
    model = WORKCELL.arm()
    inside = np.clip(joints, model.limits.lower_rad + 0.01, model.limits.upper_rad - 0.01)
    assert streams.check_joint_units(inside.tolist(), model).verdict is Verdict.OK
    degrees = np.rad2deg(inside)
    assume(model.limits.violations(degrees, slack_rad=0.01))
    check = streams.check_joint_units(degrees.tolist(), model)
    assert check.verdict is Verdict.WRONG and "degrees" in check.found


def outcome(**changes: Any) -> MotionOutcome:
    joints = WORKCELL.home_joints_rad
    return MotionOutcome.model_validate(
        {
            "stamp_ns": 2 * SECOND, "start_stamp_ns": SECOND, "duration_s": 1.0, "travel_m": 0.0,
            "stop_reason": StopReason.COMPLETED, "joints_rad": joints,
            "pose_base_peg": PoseData.of(WORKCELL.pose_base_peg(joints)), "wrench_raw": (1.0,) * 6,
            "wrench_sd": (0.0,) * 6, "peak_force_n": 0.0, "peak_moment_nm": 0.0, **changes,
        }
    )  # fmt: skip


def test_the_stream_of_joints_against_an_outcome() -> None:
    done = outcome()

    def at(joints: Any, stamp_ns: int = 2 * SECOND) -> Row:
        state = JointState(stamp_ns=stamp_ns, joints_rad=tuple(joints), speeds_rad_s=(0.0,) * 6)
        return streams.check_joint_outcome([state], done)

    home = np.asarray(WORKCELL.home_joints_rad)
    assert at(home).verdict is Verdict.OK
    assert "arm/joint_state is 57.3 times" in at(np.rad2deg(home)).found
    assert "the outcome is 57.3 times" in at(np.deg2rad(home)).found
    assert "0.01 rad apart" in at(home + 0.01).found
    assert "no sample" in at(home, 3 * SECOND).found


@pytest.mark.parametrize(("period_ms", "right"), [(2, False), (4, True), (8, True), (20, True), (25, False)])
def test_joints_are_published_as_often_as_an_arm_may_be_slow(period_ms: int, right: bool) -> None:
    """docs/own-hardware.md: an arm's period is 1 to 20 ms, and it publishes at most 250 times a second."""
    still = [
        JointState(
            stamp_ns=SECOND + index * period_ms * 1_000_000,
            joints_rad=WORKCELL.home_joints_rad,
            speeds_rad_s=(0.0,) * 6,
        )
        for index in range(20)
    ]
    assert (streams.check_joint_rate(still).verdict is Verdict.OK) is right


def test_an_outcome_against_its_own_joints_and_what_was_asked() -> None:
    model, flange = WORKCELL.arm(), WORKCELL.pose_flange_peg()
    pose = outcome().pose_base_peg.pose()
    assert streams.check_pose_outcome(outcome(), pose, model, flange).verdict is Verdict.OK
    off = PoseData(position_m=(0.0, 0.3, 0.4), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
    assert "the joints" in streams.check_pose_outcome(outcome(pose_base_peg=off), None, model, flange).found
    assert "was asked" in streams.check_pose_outcome(outcome(), off.pose(), model, flange).found


def batch(stamp_ns: int, seq: int, period_ns: int = 1_000_000, value: float = 1.0, count: int = 10) -> RawWrenchBatch:
    rows = tuple((value + 0.01 * (-1) ** row,) * 6 for row in range(count))
    return RawWrenchBatch(stamp_ns=stamp_ns, seq=seq, period_ns=period_ns, samples=rows)


@pytest.mark.parametrize("lost", [(), (3,), (2, 5, 6)])
def test_the_period_is_measured_in_spite_of_lost_batches(lost: tuple[int, ...]) -> None:
    heard = [batch(10_000_000 * seq, seq) for seq in range(12) if seq not in lost]
    assert streams.check_wrench_period(heard).verdict is Verdict.OK
    slow = [batch(20_000_000 * seq, seq) for seq in range(12) if seq not in lost]
    assert "the stamps say 2 ms" in streams.check_wrench_period(slow).found


def test_the_stream_of_the_sensor_against_an_outcome() -> None:
    heard = [batch(SECOND + 10_000_000 * seq, seq) for seq in range(90)]
    assert streams.check_wrench_outcome(heard, outcome()).verdict is Verdict.OK
    assert streams.check_wrench_outcome(heard, outcome(wrench_raw=(-1.0,) * 6)).verdict is Verdict.WRONG
    assert streams.check_wrench_outcome(heard[:0], outcome()).verdict is Verdict.WRONG


def test_stamps_on_the_clock_and_on_others() -> None:
    assert streams.check_stamps("x", [SECOND, 2 * SECOND], SECOND, 2 * SECOND).verdict is Verdict.OK
    assert "UNIX" in streams.check_stamps("x", [1_790_000_000 * SECOND], SECOND, 2 * SECOND).found
    assert "+3.000 s" in streams.check_stamps("x", [5 * SECOND], SECOND, 2 * SECOND).found
    assert "go back" in streams.check_stamps("x", [SECOND, SECOND - 5], SECOND, 2 * SECOND).found
    assert "nothing" in streams.check_stamps("x", [], SECOND, 2 * SECOND).found


def test_the_clock() -> None:
    def ticks(step_ns: int, start_ns: int = 0, boot: str = "a", count: int = 20) -> list[CellClock]:
        return [CellClock(stamp_ns=start_ns + n * step_ns, boot_id=boot, realtime=True) for n in range(count)]

    assert presence.check_clock(ticks(20_000_000)).verdict is Verdict.OK
    assert "100.0 ticks" in presence.check_clock(ticks(10_000_000)).found
    assert "UNIX" in presence.check_clock(ticks(20_000_000, 1_790_000_000 * SECOND)).found
    assert "went back" in presence.check_clock([*ticks(20_000_000, SECOND), *ticks(20_000_000)]).found
    assert presence.check_clock([]).verdict is Verdict.WRONG
    both = [*ticks(20_000_000), *ticks(20_000_000, boot="b")]
    assert "a, b" in presence.check_one_cell("cell1", both).found
    assert presence.check_one_cell("cell1", ticks(20_000_000)).verdict is Verdict.OK


# -------------------------------------------------------------------------------------------------- images, commands


def test_pictures_against_what_is_said_of_them() -> None:
    camera = CameraModel(width_px=640, height_px=480, fx_px=400.0, fy_px=400.0, cx_px=320.0, cy_px=240.0)
    here = PoseData(position_m=(0.0, 0.0, 0.0), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
    beside = here.model_copy(update={"position_m": (0.05, 0.0, 0.0)})
    calibration = CameraCalibration(
        stamp_ns=0, left=camera, right=camera, pose_left_right=beside, pose_base_camera=here
    )
    pair = StereoPair(stamp_ns=7, capture_id=1, calibration=calibration, exposure_s=0.02)
    grey = np.zeros((480, 640), np.uint8)

    def look(pixels: Any = grey, stamp_ns: int = 7, frame: str = "camera_left", rejected: str = "") -> Row:
        return images.check_image("left", Image(frame, pixels, stamp_ns), pair, rejected)

    assert look().verdict is Verdict.OK
    assert look(np.zeros((480, 640, 3), np.uint8)).found == "640 x 480 rgb8"
    assert "exchanged" in look(grey.T).found
    assert "320 x 240" in look(grey[::2, ::2]).found
    assert "from the reply" in look(stamp_ns=8).found
    assert look(frame="camera_right").verdict is Verdict.WRONG
    assert "mono16, rgb8" in look(rejected="foxglove.RawImage: 'yuv422'").mend
    assert images.check_image("left", None, pair, "").verdict is Verdict.WRONG
    left, right = Image("camera_left", grey, 7), Image("camera_right", grey + np.uint8(1), 7)
    assert images.check_pair(left, right, pair, calibration).verdict is Verdict.OK
    assert "same picture" in images.check_pair(left, left, pair, calibration).found
    assert "never told" in images.check_pair(left, right, pair, None).found
    other = calibration.model_copy(update={"pose_left_right": here.model_copy(update={"position_m": (0.06, 0.0, 0.0)})})
    assert "not the published" in images.check_pair(left, right, pair, other).found


def test_refusals_and_stops() -> None:
    def judged(answer: CommandEnd) -> Verdict:
        return check_refused("limit", answer, ("joint_limit",), "refuse it").verdict

    assert judged(CommandEnd("joint_limit")) is Verdict.OK
    assert judged(CommandEnd("busy")) is Verdict.WRONG and judged(CommandEnd(None, "completed")) is Verdict.WRONG
    stopped = outcome(stop_reason=StopReason.STOPPED)
    assert check_stop(stopped, True, 0.05, True).verdict is Verdict.OK
    assert "0.300 s after" in check_stop(stopped, True, 0.3, True).found
    assert check_stop(stopped, True, 0.3, False).verdict is Verdict.OK
    assert check_stop(stopped, False, 0.05, True).verdict is Verdict.WRONG
    assert check_stop(outcome(), True, 0.05, True).verdict is Verdict.WRONG


@given(st.lists(st.floats(-6.0, 6.0), min_size=6, max_size=6))
def test_exactly_one_joint_is_asked_beyond_its_limit_and_little(joints: list[float]) -> None:
    limits = WORKCELL.arm().limits
    here = np.clip(joints, limits.lower_rad, limits.upper_rad)
    goal = beyond(here, WORKCELL.arm())
    out = np.maximum(goal - limits.upper_rad, limits.lower_rad - goal)
    assert np.count_nonzero(out > 0.0) == 1 and out.max() == pytest.approx(0.05)


def test_a_token_that_is_missing_is_told_from_a_service_that_is() -> None:
    assert presence.check_token("camera", True, True).verdict is Verdict.OK
    assert "not declared" in presence.check_token("camera", False, True).found
    assert "not there" in presence.check_token("camera", False, False).found
    assert presence.check_contract([]).verdict is Verdict.OK
    assert "clock: no" in presence.check_contract(["clock: no"]).found
