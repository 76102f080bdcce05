"""Pushes and weighings read from a recording: the commanded motions, and the outcome of each.

A push is a guarded move that ended in contact and did not draw back. The dwell before it is free air; the dwells after
it, and after each straight move further in, are its depths. All other dwells are weighings. Of dwells at one place the
longest counts. Where the recording says that the arm was held for `crosspih calibrate`, only the last such time with a
push in it is used.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.calibration.presses import Press, Pressed, RestLevel
from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.keys import (
    ADMITTANCE_MOVE,
    DWELL,
    FOLLOW,
    GUARDED_MOVE,
    IDENTIFY_PAYLOAD,
    LEASE_GIVE,
    LEASE_TAKE,
    MOVE_LINEAR,
    REFUSAL,
    Command,
    Topic,
)
from crosspih_common.messages import (
    Dwell,
    GuardedMove,
    IdentifyPayload,
    MotionOutcome,
    MoveLinear,
    RawReading,
    StopReason,
)
from crosspih_common.messages.motion import Held
from crosspih_common.recording import Recording, read_recording

MOTIONS: tuple[Command[Any, Any], ...] = (FOLLOW, MOVE_LINEAR, GUARDED_MOVE, ADMITTANCE_MOVE, DWELL)
SUFFIX, PURPOSE = ".mcap", "calibrate "
MIN_HELD_S = 0.25
SAME_WAY = 1e-6


def echoes(commands: Iterable[Command[Any, Any]]) -> list[Topic[Any]]:
    """The echoes of commands by their servers, and the refusals."""
    return [REFUSAL, *(echo for command in commands for echo in (command.request_echo, command.reply_echo))]


TOPICS = echoes((*MOTIONS, LEASE_TAKE, LEASE_GIVE, IDENTIFY_PAYLOAD))


@dataclass(frozen=True, slots=True)
class Moved:
    """A motion that was commanded, and its end."""

    request: Held
    outcome: MotionOutcome


@dataclass(frozen=True, slots=True)
class Holding:
    """One time that the arm was held: the lease, its purpose, and its begin and end, cell clock."""

    lease: str
    purpose: str
    from_ns: int
    to_ns: int


@dataclass(slots=True)
class Pushed:
    """The dwells: free air and depths of each push, its direction, and the weighings."""

    pushes: list[tuple[MotionOutcome, list[MotionOutcome]]] = field(default_factory=list)
    ways: list[tuple[float, ...]] = field(default_factory=list)
    weighings: list[MotionOutcome] = field(default_factory=list)
    touched: int = 0  # guarded moves that ended in contact and stayed there


def is_recording(path: Path) -> bool:
    """Whether a file is a recording, by its name."""
    return path.suffix.lower() == SUFFIX


def opened(path: Path, topics: Iterable[Topic[Any]], workcell: Workcell) -> tuple[Recording, list[str]]:
    """The recording, and notes about it: torn, messages missing, another cell.

    Raises RecordingError, and ConfigError where it is of an arm with other joints.
    """
    recording = read_recording(path, topics)
    notes = [] if recording.finished else [f"{path}: was torn off ({recording.tear}); what is whole is taken"]
    notes += [f"{path}: {count} messages of {key} are missing" for key, count in recording.seq_gaps().items()]
    if recording.cell and recording.cell != workcell.name:
        notes.append(f"{path}: is of the cell {recording.cell}, reckoned with the file of {workcell.name} (--cell)")
    joints = {len(moved.outcome.joints_rad) for moved in motions(recording)}
    if joints - {workcell.arm().joints}:
        raise ConfigError(
            f"{path}: is of an arm with {max(joints)} joints, the cell's file has {workcell.arm().joints}; name its "
            "cell's file with --cell"
        )
    return recording, notes


def motions(recording: Recording) -> list[Moved]:
    """All motions that ended, in the order in which they began."""
    found = [
        Moved(request.value, reply.value)
        for command in MOTIONS
        for request, reply in recording.answered(command)
        if reply is not None
    ]
    return sorted(found, key=lambda moved: (moved.outcome.start_stamp_ns, moved.outcome.stamp_ns))


def holdings(recording: Recording) -> list[Holding]:
    """Each time that somebody held the arm, in order; one that was never released lasts to the end."""
    given = {message.lease: message.stamp_ns for message in recording.messages(LEASE_GIVE.request_echo)}
    return [
        Holding(granted.value.lease, taken.value.purpose, granted.value.stamp_ns,
                given.get(granted.value.lease, recording.span_ns()[1]))
        for taken, granted in recording.answered(LEASE_TAKE)
        if granted is not None
    ]  # fmt: skip


def _longest(dwells: list[MotionOutcome]) -> MotionOutcome | None:
    """The last of the longest dwells, where it is long enough to count."""
    longest = max(reversed(dwells), key=lambda dwell: dwell.duration_s, default=None)
    return longest if longest is not None and longest.duration_s >= MIN_HELD_S - 1e-6 else None


def pushed(moved: Iterable[Moved]) -> Pushed:
    """Sort the motions, in their order, into pushes and weighings."""
    found, here = Pushed(), list[MotionOutcome]()
    free: MotionOutcome | None = None
    levels: list[MotionOutcome] | None = None  # of the current push
    way, at = np.zeros(3), np.zeros(3)

    def ended() -> None:
        nonlocal levels
        if levels is not None and free is not None and len(levels) > 1:
            found.pushes.append((free, levels))
            found.ways.append(tuple(way.tolist()))
        levels = None

    for one in moved:
        if isinstance(one.request, Dwell):
            here.append(one.outcome)
            continue
        held, before, at = _longest(here), at, one.outcome.pose_base_peg.pose().translation_m
        here = []
        if levels is not None:
            levels += [] if held is None else [held]
            if isinstance(one.request, MoveLinear) and float(way @ (at - before)) > 0.0:
                continue
            ended()
            held = None
        if isinstance(one.request, GuardedMove):
            if one.outcome.stop_reason is StopReason.CONTACT and one.request.retreat_m == 0.0:
                found.touched += 1
                free, levels, way = held, [], np.asarray(one.request.direction_base, float)
        elif held is not None:
            found.weighings.append(held)
    held = _longest(here)
    if levels is not None:
        levels += [] if held is None else [held]
        ended()
    elif held is not None:
        found.weighings.append(held)
    return found


def of_calibration(recording: Recording) -> Pushed:
    """The pushes of the last calibration in the recording; of the whole recording where it names no calibration."""
    every = motions(recording)
    for holding in reversed(holdings(recording)):
        if holding.purpose.startswith(PURPOSE):
            found = pushed(one for one in every if one.request.lease == holding.lease)
            if found.pushes:
                return found
    return pushed(every)


def _level(outcome: MotionOutcome) -> RestLevel:
    return RestLevel(joints_rad=outcome.joints_rad, raw=outcome.wrench_raw, raw_sd=outcome.wrench_sd)


def pressed_of(path: Path, workcell: Workcell) -> tuple[Pressed, list[str]]:
    """The pushes and weighings of a recording as `crosspih calibrate` keeps them, and notes for people.

    Pushes go along the plate's normal, so their direction is used as the normal. Raises RecordingError, and ConfigError
    naming what the recording lacks.
    """
    recording, notes = opened(path, TOPICS, workcell)
    found = of_calibration(recording)
    if not found.pushes:
        raise ConfigError(f"{path}: {_lacking(recording, found)}")
    ways = np.array(found.ways)
    if float(np.abs(ways - ways[0]).max()) > SAME_WAY:
        raise ConfigError(
            f"{path}: its {len(ways)} pushes go in different directions (arm/guarded_move, direction_base); want all "
            "along the normal of one plate"
        )
    last_ns = max(sample.wall_ns for samples in recording.samples.values() for sample in samples)
    pressed = Pressed.model_validate({
        "taken_at": datetime.fromtimestamp(last_ns // 1_000_000_000, timezone.utc), "cell": recording.cell,
        "normal_base": found.ways[0],
        "presses": tuple(
            Press(free=_level(free), levels=tuple(map(_level, levels))) for free, levels in found.pushes
        ),
        "weighings": tuple(map(_level, found.weighings)),
    })  # fmt: skip
    return pressed, notes


def _lacking(recording: Recording, found: Pushed) -> str:
    guarded, dwells = len(recording.answered(GUARDED_MOVE)), len(recording.answered(DWELL))
    for name, count in ((GUARDED_MOVE.path, guarded), (DWELL.path, dwells)):
        if not count:
            return f"holds no {name}; a push is a guarded move into the plate, and dwells before and after it"
    if not found.touched:
        return (
            f"none of its {guarded} guarded moves ended in contact and stayed there (retreat_m: 0); a "
            "push is held after it touched"
        )
    return (
        f"{found.touched} times the peg touched and stayed, and none was held for {MIN_HELD_S:g} s or longer in free "
        "air just before it and then at two depths (arm/dwell, arm/move_linear)"
    )


def readings_of(path: Path, workcell: Workcell) -> tuple[IdentifyPayload, list[str]]:
    """The sensor's readings in several orientations: as the last calibration of it was asked for, else all dwells in
    free air. Raises RecordingError, and ConfigError naming what the recording lacks.
    """
    recording, notes = opened(path, TOPICS, workcell)
    asked = [request.value for request, reply in recording.answered(IDENTIFY_PAYLOAD) if reply is not None]
    if asked:
        return asked[-1], notes
    found = of_calibration(recording)
    free = [*found.weighings, *(free for free, _ in found.pushes)]
    if not free:
        raise ConfigError(
            f"{path}: holds neither a calibration of the sensor (force_torque/identify) nor dwells of "
            f"{MIN_HELD_S:g} s in free air (arm/dwell)"
        )
    readings = [
        RawReading(pose_base_peg=one.pose_base_peg, wrench_raw=one.wrench_raw, wrench_sd=one.wrench_sd) for one in free
    ]
    return IdentifyPayload(readings=tuple(readings)), notes
