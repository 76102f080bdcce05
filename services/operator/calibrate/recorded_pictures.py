"""The pairs of pictures in a recording, and the joints of the arm when each was taken."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.keys import CAPTURE, IMAGE_LEFT, IMAGE_RIGHT, JOINT_STATE, LEASE_GIVE, LEASE_TAKE
from crosspih_common.messages import Dwell, JointState, StereoPair
from crosspih_common.plain_yaml import yaml_of
from crosspih_common.recording import Recording
from services.operator.calibrate.folder import Taken, TakenPair, save_taken, write_pair
from services.operator.calibrate.recorded import MOTIONS, PURPOSE, Moved, echoes, holdings, motions, opened

TOPICS = [*echoes((*MOTIONS, CAPTURE, LEASE_TAKE, LEASE_GIVE)), IMAGE_LEFT, IMAGE_RIGHT, JOINT_STATE]
NEAR_NS = 20_000_000  # from a picture to the nearest encoder sample
AT_REST_RAD_S = 2e-3


@dataclass(slots=True)
class _Arm:
    """The joints of the arm at a time."""

    moved: list[Moved]
    states: list[JointState]
    began: list[int] = field(init=False)
    stamps: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.began = [one.outcome.start_stamp_ns for one in self.moved]
        self.stamps = [state.stamp_ns for state in self.states]

    def at(self, stamp_ns: int) -> tuple[tuple[float, ...] | None, str]:
        """Joints, rad, as the calibration saw them: from the dwell that has just ended, else from the nearest encoder
        sample. Where there are none, the reason.
        """
        index = bisect_right(self.began, stamp_ns)
        if index:
            last = self.moved[index - 1]
            if isinstance(last.request, Dwell) and last.outcome.stamp_ns <= stamp_ns:
                return last.outcome.joints_rad, ""
        after = bisect_left(self.stamps, stamp_ns)
        near = min(
            self.states[max(after - 1, 0) : after + 1], key=lambda one: abs(one.stamp_ns - stamp_ns), default=None
        )
        if near is None or abs(near.stamp_ns - stamp_ns) > NEAR_NS:
            return None, f"no {JOINT_STATE.path} within {NEAR_NS * 1e-6:.0f} ms of it"
        if max(map(abs, near.speeds_rad_s)) > AT_REST_RAD_S:
            return None, "the arm moved"
        return near.joints_rad, ""


def taken_of(path: Path, folder: Path, board: str | None, workcell: Workcell) -> tuple[Taken, list[str]]:
    """The pairs of the last calibration in the recording (of the whole recording, where it names no calibration) as
    files in `folder`, as `crosspih calibrate` keeps them; and notes for people.

    Without `board` the pattern is that of the cell's file in the recording. Raises RecordingError, and ConfigError
    naming what the recording lacks.
    """
    recording, notes = opened(path, TOPICS, workcell)
    pattern = board or _board_of(recording)
    captured = _of_calibration(recording)
    sides = [{image.stamp_ns: image for image in recording.messages(topic)} for topic in (IMAGE_LEFT, IMAGE_RIGHT)]
    arm = _Arm(motions(recording), recording.messages(JOINT_STATE))
    start_ns, pairs = recording.span_ns()[0], list[TakenPair]()
    for one in captured:
        at = f"{path}: the pair at {(one.stamp_ns - start_ns) * 1e-9:.3f} s"
        left, right = (images.get(one.stamp_ns) for images in sides)
        if left is None or right is None:
            lost = (IMAGE_LEFT if left is None else IMAGE_RIGHT).path
            notes.append(f"{at} is left out: {lost} has no picture of that stamp")
            continue
        joints, why = arm.at(one.stamp_ns)
        if joints is None:
            notes.append(f"{at} does not say how the arm stood: {why}")
        pairs.append(write_pair(folder, len(pairs), left, right, joints))
    if not pairs:
        raise ConfigError(
            f"{path}: holds no pair of pictures: {len(captured)} answers of {CAPTURE.path}, {len(sides[0])} of "
            f"{IMAGE_LEFT.path}, {len(sides[1])} of {IMAGE_RIGHT.path}, want all three with one stamp"
        )
    last_ns = max(sample.wall_ns for samples in recording.samples.values() for sample in samples)
    taken = Taken(
        taken_at=datetime.fromtimestamp(last_ns // 1_000_000_000, timezone.utc), cell=recording.cell, board=pattern,
        calibration=captured[-1].calibration, pairs=tuple(pairs),
    )  # fmt: skip
    save_taken(folder, taken)
    return taken, notes


def _of_calibration(recording: Recording) -> list[StereoPair]:
    every = recording.messages(CAPTURE.reply_echo)
    for holding in reversed(holdings(recording)):
        if holding.purpose.startswith(PURPOSE):
            inside = [one for one in every if holding.from_ns <= one.stamp_ns <= holding.to_ns]
            if inside:
                return inside
    return every


def _board_of(recording: Recording) -> str:
    content = yaml_of(recording.metadata.get("cell", {}).get("yaml", "")) or {}
    board = (content.get("operator") or {}).get("board") or {}
    if "pattern" not in board:
        raise ConfigError(
            f"{recording.path}: its cell's file names no board; say which the pictures show, such as --board "
            "9x6:0.02:0.015:DICT_4X4_50"
        )
    return str(board["pattern"])
