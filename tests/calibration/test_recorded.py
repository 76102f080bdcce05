"""Pairs of pictures and pushes out of recordings that are made by hand; what such a recording lacks is named."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import deploy
from crosspih_common.config import Workcell, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.keys import (
    CAPTURE,
    DWELL,
    FOLLOW,
    GUARDED_MOVE,
    IMAGE_LEFT,
    IMAGE_RIGHT,
    JOINT_STATE,
    LEASE_GIVE,
    LEASE_TAKE,
    MOVE_LINEAR,
)
from crosspih_common.messages import (
    CameraCalibration,
    CameraModel,
    CaptureStereo,
    Dwell,
    FollowTrajectory,
    GiveLease,
    GuardedMove,
    GuardedMoveOutcome,
    Image,
    JointKnot,
    JointState,
    LeaseGiven,
    LeaseGranted,
    MotionOutcome,
    MoveLinear,
    PoseData,
    StereoPair,
    StopReason,
    TakeLease,
)
from services.operator.calibrate.recorded import pressed_of, readings_of
from services.operator.calibrate.recorded_pictures import taken_of
from tests.calibration.recordings import MS, Said, recording_of

WORKCELL = Workcell()
PANDA = Path(deploy.__file__).parent / "cells" / "panda.yaml"
PATTERN = "7x5:0.018:0.012:DICT_4X4_50"
SOMEWHERE = PoseData(position_m=(0.0, 0.0, 0.0), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0))
LENS = CameraModel(width_px=16, height_px=12, fx_px=10.0, fy_px=10.0, cx_px=8.0, cy_px=6.0)
TOLD = CameraCalibration(left=LENS, right=LENS, pose_left_right=SOMEWHERE, pose_base_camera=SOMEWHERE)
DOWN = (0.0, 0.0, -1.0)


def joints(number: float) -> tuple[float, ...]:
    return (0.1 * number, 0.2, -0.3, 0.4, 0.5, -0.6)


def picture(number: int, at_ms: int, side: str) -> Image:
    pixels = np.random.default_rng([number, len(side)]).integers(0, 256, (12, 16)).astype(np.uint8)
    return Image(frame=side, pixels=pixels, stamp_ns=at_ms * MS)


def pair(number: int, at_ms: int, sides: tuple[str, ...] = ("left", "right")) -> list[Said]:
    topics = {"left": IMAGE_LEFT, "right": IMAGE_RIGHT}
    images = [Said(topics[side], picture(number, at_ms, side), at_ms) for side in sides]
    reply = StereoPair(capture_id=number, exposure_s=0.01, calibration=TOLD)
    return [
        Said(CAPTURE.request_echo, CaptureStereo(), at_ms - 1), *images, Said(CAPTURE.reply_echo, reply, at_ms),
    ]  # fmt: skip


def ended(start_ms: int, at_ms: int, number: float, height_m: float = 0.0, force_n: float = 0.0) -> dict[str, object]:
    return {
        "stop_reason": StopReason.COMPLETED, "start_stamp_ns": start_ms * MS, "duration_s": 1e-3 * (at_ms - start_ms),
        "travel_m": 0.0, "joints_rad": joints(number),
        "pose_base_peg": PoseData(position_m=(0.4, -0.3, height_m), quaternion_xyzw=(0.0, 0.0, 0.0, 1.0)),
        "wrench_raw": (0.1, 0.2, -9.0 - force_n, 0.01, 0.02, 0.03), "wrench_sd": (0.01,) * 6, "peak_force_n": force_n,
        "peak_moment_nm": 0.0,
    }  # fmt: skip


def dwell(start_ms: int, at_ms: int, number: float, lease: str = "", force_n: float = 0.0) -> list[Said]:
    outcome = MotionOutcome.model_validate(ended(start_ms, at_ms, number, force_n=force_n))
    asked = Dwell(duration_s=1e-3 * (at_ms - start_ms), lease=lease)
    return [Said(DWELL.request_echo, asked, start_ms), Said(DWELL.reply_echo, outcome, at_ms)]


def free_way(start_ms: int, at_ms: int, lease: str = "") -> list[Said]:
    knots = (JointKnot(time_s=0.0, joints_rad=joints(0)), JointKnot(time_s=1.0, joints_rad=joints(1)))
    outcome = MotionOutcome.model_validate(ended(start_ms, at_ms, 1))
    asked = FollowTrajectory(knots=knots, lease=lease)
    return [Said(FOLLOW.request_echo, asked, start_ms), Said(FOLLOW.reply_echo, outcome, at_ms)]


def line(start_ms: int, at_ms: int, height_m: float, lease: str = "") -> list[Said]:
    outcome = MotionOutcome.model_validate(ended(start_ms, at_ms, 1, height_m))
    asked = MoveLinear(pose_base_peg=outcome.pose_base_peg, lease=lease)
    return [Said(MOVE_LINEAR.request_echo, asked, start_ms), Said(MOVE_LINEAR.reply_echo, outcome, at_ms)]


def touch(start_ms: int, at_ms: int, lease: str = "", way: tuple[float, ...] = DOWN, back_m: float = 0.0) -> list[Said]:
    outcome = GuardedMoveOutcome.model_validate({
        **ended(start_ms, at_ms, 1), "stop_reason": StopReason.CONTACT, "direction_base": way,
    })  # fmt: skip
    asked = GuardedMove.model_validate({
        "direction_base": way, "speed_m_s": 0.004, "travel_limit_m": 0.01, "retreat_m": back_m, "lease": lease,
    })  # fmt: skip
    return [Said(GUARDED_MOVE.request_echo, asked, start_ms), Said(GUARDED_MOVE.reply_echo, outcome, at_ms)]


def held(purpose: str, lease: str, from_ms: int, to_ms: int) -> tuple[list[Said], list[Said]]:
    granted = LeaseGranted(lease=lease, holder="operator", timeout_s=1.0, beat_s=0.1)
    return (
        [
            Said(LEASE_TAKE.request_echo, TakeLease(holder="operator", purpose=purpose), from_ms),
            Said(LEASE_TAKE.reply_echo, granted, from_ms),
        ],
        [
            Said(LEASE_GIVE.request_echo, GiveLease(lease=lease), to_ms),
            Said(LEASE_GIVE.reply_echo, LeaseGiven(was_held=True), to_ms),
        ],
    )


def push(start_ms: int, lease: str = "", way: tuple[float, ...] = DOWN) -> list[Said]:
    """Free air, a touch, two depths, the short dwell before it is drawn back, and back."""
    at = start_ms
    return [
        *dwell(at, at + 150, 1.0, lease), *dwell(at + 150, at + 650, 1.1, lease),
        *touch(at + 700, at + 900, lease, way),
        *dwell(at + 900, at + 1050, 1.2, lease, 4.0), *dwell(at + 1050, at + 1550, 1.3, lease, 4.0),
        *line(at + 1600, at + 1700, -0.001, lease),
        *dwell(at + 1700, at + 1850, 1.4, lease, 9.0), *dwell(at + 1850, at + 2350, 1.5, lease, 9.0),
        *dwell(at + 2350, at + 2400, 1.6, lease, 9.0), *line(at + 2450, at + 2600, 0.02, lease),
    ]  # fmt: skip


def test_pairs_come_with_the_joints_of_the_dwell_before_them_or_of_the_encoders(tmp_path: Path) -> None:
    at_rest, moving = (JointState(joints_rad=joints(9), speeds_rad_s=(speed,) * 6) for speed in (0.0, 0.1))
    path = recording_of(
        tmp_path,
        [
            *pair(0, 100),  # before anybody moved, and without encoders
            *dwell(200, 350, 2.0), *pair(1, 360),
            *free_way(400, 900), Said(JOINT_STATE, at_rest, 1000), *pair(2, 1005),
            *pair(3, 1010, ("left",)),
            Said(JOINT_STATE, moving, 1100), *pair(4, 1101),
        ],
    )  # fmt: skip
    taken, notes = taken_of(path, tmp_path, PATTERN, WORKCELL)
    assert [one.joints_rad for one in taken.pairs] == [None, joints(2.0), joints(9), None]
    assert taken.board == PATTERN and taken.calibration is not None and taken.calibration.left == LENS
    for number, one in zip((0, 1, 2, 4), taken.pairs, strict=True):
        for side, name in (("left", one.left), ("right", one.right)):
            stored = cv2.imread(str(tmp_path / name), cv2.IMREAD_UNCHANGED)
            assert stored is not None and np.array_equal(stored, picture(number, 0, side).pixels)
    said = " / ".join(notes)
    assert "no arm/joint_state within 20 ms" in said and "the arm moved" in said
    assert "the pair at 0.911 s is left out: camera/right/image" in said


def test_the_last_calibration_counts_and_what_others_did_does_not(tmp_path: Path) -> None:
    take, give = held("calibrate stereo", "a", 500, 900)
    path = recording_of(tmp_path, [*pair(0, 100), *take, *pair(1, 600), *pair(2, 700), *give, *pair(3, 1000)])
    taken, _ = taken_of(path, tmp_path, PATTERN, WORKCELL)
    first = cv2.imread(str(tmp_path / taken.pairs[0].left), cv2.IMREAD_UNCHANGED)
    assert len(taken.pairs) == 2 and np.array_equal(np.asarray(first), picture(1, 0, "left").pixels)
    take, give = held("calibrate mount", "b", 4000, 20_000)
    others, ours = push(100, "x"), [*dwell(4100, 4600, 0.5, "b"), *free_way(4700, 4800, "b"), *push(5000, "b")]
    found, _ = pressed_of(recording_of(tmp_path, [*others, *take, *ours, *push(8000, "b"), *give]), WORKCELL)
    assert len(found.presses) == 2 and found.normal_base == DOWN
    assert found.presses[0].free.joints_rad == joints(1.1)
    assert [level.joints_rad for level in found.presses[0].levels] == [joints(1.3), joints(1.5)]
    assert [level.joints_rad for level in found.weighings] == [joints(0.5)]


def test_pushes_that_nobody_calls_a_calibration_are_taken_and_weighings_serve_the_sensor(tmp_path: Path) -> None:
    path = recording_of(tmp_path, [*dwell(100, 600, 0.7), *free_way(700, 900), *push(1000)])
    found, notes = pressed_of(path, WORKCELL)
    assert len(found.presses) == 1 and notes == []
    asked, _ = readings_of(path, WORKCELL)
    assert len(asked.readings) == 2 and asked.readings[0].wrench_raw == (0.1, 0.2, -9.0, 0.01, 0.02, 0.03)


def test_what_a_recording_lacks_is_named(tmp_path: Path) -> None:
    drawn_back = [*dwell(100, 600, 1.0), *touch(700, 900, back_m=0.01)]
    for said, why in (
        (free_way(100, 200), "holds no arm/guarded_move"),
        (touch(100, 200), "holds no arm/dwell"),
        (drawn_back, "none of its 1 guarded moves ended in contact and stayed there"),
        (touch(100, 200) + dwell(300, 400, 1.0), "1 times the peg touched and stayed, and none was held"),
        (push(100) + push(4000, way=(0.0, 0.6, -0.8)), "its 2 pushes go in different directions"),
    ):
        with pytest.raises(ConfigError, match=why):
            pressed_of(recording_of(tmp_path, said), WORKCELL)
    with pytest.raises(ConfigError, match="holds no pair of pictures: 0 answers of camera/capture"):
        taken_of(recording_of(tmp_path, free_way(100, 200)), tmp_path, PATTERN, WORKCELL)
    with pytest.raises(ConfigError, match="its cell's file names no board"):
        taken_of(recording_of(tmp_path, pair(0, 100)), tmp_path, None, WORKCELL)
    with pytest.raises(ConfigError, match="holds neither a calibration of the sensor"):
        readings_of(recording_of(tmp_path, free_way(100, 200)), WORKCELL)
    seven = load_cell(PANDA).workcell
    with pytest.raises(ConfigError, match="an arm with 6 joints"):
        pressed_of(recording_of(tmp_path, push(100)), seven)
