"""What a recording holds of the devices, as arrays: read once, before anything is played.

What the recorder has at full rate are the sensor's samples, in batches, and every picture that was taken. Joint states
are published 250 times a second, or once a cycle of an arm that is slower: an arm with a shorter cycle was somewhere in
between meanwhile, and nothing says where but the states around it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crosspih_common.errors import ConfigError
from crosspih_common.geometry.pose import Array
from crosspih_common.keys import CAPTURE, CLOCK, IMAGE_LEFT, IMAGE_RIGHT, JOINT_STATE, WRENCH_RAW, Topic
from crosspih_common.messages import CameraCalibration
from crosspih_common.recording import Recorded, Recording, RecordingError, read_recording

FIELD = "hardware.recorded.file"
PLAYED: tuple[Topic[Any], ...] = (
    CLOCK, JOINT_STATE, WRENCH_RAW, IMAGE_LEFT, IMAGE_RIGHT, CAPTURE.request_echo, CAPTURE.reply_echo,
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class JointTrack:
    """Stamps (k,), ns, rising; positions (k, n), rad, and speeds (k, n), rad/s, at them.

    `start_ns` is the cell's time when the recording began, at most one period before the first stamp: the arm of a cell
    whose time stands between commands was where the first state says, at rest. `period_ns` is the usual step.
    """

    start_ns: int
    period_ns: int
    stamps_ns: NDArray[np.int64]
    positions_rad: Array
    speeds_rad_s: Array


@dataclass(frozen=True, slots=True, eq=False)
class WrenchTrack:
    """Stamps (m,), ns, rising, and raw wrenches (m, 6) at them; `period_ns` is what the batches say."""

    period_ns: int
    stamps_ns: NDArray[np.int64]
    wrenches: Array
    gaps: int


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPair:
    """A pair of pictures as it lies in the file, and what was asked for; None where the recording does not say."""

    stamp_ns: int
    exposure_s: float
    calibration: CameraCalibration
    exposure_scale: float | None
    lamp: int | None
    left: Recorded
    right: Recorded

    @property
    def end_ns(self) -> int:
        """When its exposure had ended."""
        return self.stamp_ns + round(self.exposure_s * 1e9)


def open_recording(path: Path, torn: bool) -> Recording:
    """The recording, what the devices said alone. Raises ConfigError: no recording, torn off."""
    try:
        recording = read_recording(path, PLAYED)
    except RecordingError as error:
        raise ConfigError(f"{FIELD}: {error}") from None
    if not recording.finished and not torn:
        begun_ns, ended_ns = recording.span_ns()
        raise ConfigError(
            f"{FIELD}: {path} was torn off after {(ended_ns - begun_ns) * 1e-9:.3f} s "
            f"({recording.tear or 'no footer'}); set hardware.recorded.torn: true to play what is whole"
        )
    return recording


def begun_ns(recording: Recording) -> int:
    """The cell's time at which the recording began: that of its first tick, else of its first sample."""
    ticks = [sample.stamp_ns for key in recording.keys_of(CLOCK) for sample in recording.samples[key]]
    return ticks[0] if ticks else recording.span_ns()[0]


def joint_track(recording: Recording) -> JointTrack:
    """The encoders. Raises ConfigError: none, or two runs of a cell in one file."""
    states = _messages(recording, JOINT_STATE)
    stamps = np.array([state.stamp_ns for state in states], dtype=np.int64)
    _refuse_turned_back(recording, JOINT_STATE, stamps)
    fresh = np.append(np.diff(stamps) > 0, True)  # of two with one stamp the later one holds
    stamps = stamps[fresh]
    if len(stamps) < 2:
        raise ConfigError(f"{FIELD}: {recording.path} holds one {JOINT_STATE.path} only; that is no motion to play")
    counts = sorted({len(state.joints_rad) for state in states})
    if len(counts) != 1:
        raise ConfigError(
            f"{FIELD}: {JOINT_STATE.path} has {' and '.join(map(str, counts))} joints in {recording.path}"
        )
    period_ns = int(np.median(np.diff(stamps)))
    first_ns, began_ns = int(stamps[0]), begun_ns(recording)
    return JointTrack(
        start_ns=began_ns if 0 < first_ns - began_ns <= period_ns else first_ns,
        period_ns=period_ns,
        stamps_ns=stamps,
        positions_rad=np.array([state.joints_rad for state in states])[fresh],
        speeds_rad_s=np.array([state.speeds_rad_s for state in states])[fresh],
    )


def wrench_track(recording: Recording) -> WrenchTrack:
    """The sensor. Raises ConfigError: none, two runs in one file, or a rate that changes."""
    batches = _messages(recording, WRENCH_RAW)
    periods = sorted({batch.period_ns for batch in batches})
    if len(periods) != 1:
        raise ConfigError(f"{FIELD}: {WRENCH_RAW.path} has periods of {periods} ns in {recording.path}; want one rate")
    period_ns = periods[0]
    stamps = np.concatenate([batch.stamp_ns + period_ns * np.arange(len(batch.samples)) for batch in batches])
    _refuse_turned_back(recording, WRENCH_RAW, stamps)
    return WrenchTrack(
        period_ns=period_ns,
        stamps_ns=stamps.astype(np.int64),
        wrenches=np.concatenate([np.asarray(batch.samples, float) for batch in batches]),
        gaps=int(np.count_nonzero(np.diff(stamps) > 1.5 * period_ns)),
    )


def picture_track(recording: Recording) -> tuple[tuple[RecordedPair, ...], int]:
    """The pairs in the order in which they were taken, and how many more were named by a reply but not found whole.

    Raises ConfigError where there is none.
    """
    for topic in (CAPTURE.reply_echo, IMAGE_LEFT, IMAGE_RIGHT):
        if not recording.keys_of(topic):
            raise _missing(
                recording,
                topic,
                "leave the camera out (hardware.devices: [arm, force_torque]) or name another driver for it "
                "(hardware.drivers.camera)",
            )
    pictures = [
        {sample.stamp_ns: sample for key in recording.keys_of(topic) for sample in recording.samples[key]}
        for topic in (IMAGE_LEFT, IMAGE_RIGHT)
    ]
    asked_for = {
        reply.value.stamp_ns: request.value for request, reply in recording.answered(CAPTURE) if reply is not None
    }
    pairs, lost = [], 0
    for reply in recording.sent(CAPTURE.reply_echo):
        stamp_ns = reply.value.stamp_ns
        left, right = (found.get(stamp_ns) for found in pictures)
        if left is None or right is None:
            lost += 1
            continue
        asked = asked_for.get(stamp_ns)
        pairs.append(
            RecordedPair(
                stamp_ns=stamp_ns,
                exposure_s=reply.value.exposure_s,
                calibration=reply.value.calibration,
                exposure_scale=None if asked is None else asked.exposure_scale,
                lamp=None if asked is None else asked.lamp,
                left=left,
                right=right,
            )
        )
    if not pairs:
        raise ConfigError(f"{FIELD}: {recording.path} names {lost} pairs of pictures and holds none of them whole")
    return tuple(pairs), lost


def _messages(recording: Recording, topic: Topic[Any]) -> list[Any]:
    messages = recording.messages(topic)
    if not messages:
        raise _missing(recording, topic, "record a cell whose arm and sensor run")
    return messages


def _missing(recording: Recording, topic: Topic[Any], mend: str) -> ConfigError:
    undecoded = f" that can be read ({recording.problems[0]})" if recording.problems else ""
    return ConfigError(f"{FIELD}: {recording.path} holds no {topic.path}{undecoded}; {mend}")


def _refuse_turned_back(recording: Recording, topic: Topic[Any], stamps_ns: NDArray[np.int64]) -> None:
    steps = np.diff(stamps_ns)
    if np.any(steps < 0):
        at = int(np.argmax(steps < 0))
        raise ConfigError(
            f"{FIELD}: {topic.path} goes back from {stamps_ns[at] * 1e-9:.3f} to {stamps_ns[at + 1] * 1e-9:.3f} s in "
            f"{recording.path}: the cell was started again while it was recorded; make a recording for each run"
        )
