"""A recording as a timeline: decoded once, pictures only when they are shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crosspih_common.bus.codec import decode
from crosspih_common.config import CellFile, cell_of_text, load_cell
from crosspih_common.errors import ConfigError, ContractError
from crosspih_common.keys import (
    ANNOTATED_LEFT,
    ANNOTATED_RIGHT,
    ASSEMBLE,
    CAMERA_CALIBRATION,
    CONTACT_STATE,
    CONTACT_WRENCH,
    ESTIMATE,
    EVENTS,
    IMAGE_LEFT,
    IMAGE_RIGHT,
    JOINT_STATE,
    LEASE,
    LOCATE,
    NETWORK,
    PHASE,
    SEATED,
    SEQUENCE_NETWORK,
    STATUS,
    TOUCH,
    WITHDRAW,
    Topic,
)
from crosspih_common.messages import Image
from crosspih_common.modules import DEFAULT_CELL
from crosspih_common.recording.reader import Recorded, RecordingError, read_recording
from services.viewer.timeline import StampedPicture, Timeline

PICTURES: dict[str, Topic[Image]] = {
    "left": IMAGE_LEFT,
    "right": IMAGE_RIGHT,
    "annotated left": ANNOTATED_LEFT,
    "annotated right": ANNOTATED_RIGHT,
}


@dataclass(frozen=True, slots=True, eq=False)
class ShownRecording:
    """A recording that can be shown: its cell, and its messages."""

    path: Path
    cell: CellFile
    timeline: Timeline
    notes: tuple[str, ...]


def _listeners(timeline: Timeline) -> list[tuple[Topic[Any], Callable[[Any], None]]]:
    return [
        (JOINT_STATE, timeline.joint_state),
        (CONTACT_WRENCH, timeline.contact_wrench),
        (CONTACT_STATE, timeline.contact_state),
        (PHASE, timeline.phase),
        (TOUCH, timeline.touch),
        (LOCATE.reply_echo, timeline.hole),
        (ESTIMATE.reply_echo, lambda heard: timeline.estimate(heard, "touches")),
        (NETWORK.reply_echo, lambda heard: timeline.estimate(heard, "the network")),
        (SEQUENCE_NETWORK.reply_echo, lambda heard: timeline.estimate(heard, "the sequence network")),
        (SEATED.reply_echo, lambda heard: timeline.estimate(heard, "the bore's walls")),
        (ASSEMBLE.reply_echo, timeline.result),
        (WITHDRAW.reply_echo, timeline.withdraw),
        (CAMERA_CALIBRATION, timeline.calibration),
        (LEASE, timeline.lease),
        (STATUS, timeline.status),
        (EVENTS, timeline.event),
    ]


def read_tape(path: Path, cell_file: Path | None = None) -> ShownRecording:
    """Read a recording. The cell is the one in the recording, unless `cell_file` names another.

    Raises RecordingError where the file is no recording, or has nothing to show; ConfigError where its cell cannot be
    read.
    """
    probe = Timeline(6)
    wanted = [topic for topic, _ in _listeners(probe)] + list(PICTURES.values())
    recording = read_recording(path, wanted)
    notes = [recording.tear] if recording.tear else []
    told = recording.metadata.get("cell", {})
    if cell_file is not None:
        cell = load_cell(cell_file)
    elif told.get("yaml"):
        try:
            cell = cell_of_text(Path(told.get("path") or path), told["yaml"])
        except ConfigError as error:
            raise ConfigError(f"{error}; name the cell's file with --cell") from None
    else:
        notes.append("the recording does not say of which cell it is: the default cell is shown; name one with --cell")
        cell = load_cell(DEFAULT_CELL)
    timeline = Timeline(cell.workcell.arm().joints)
    for topic, take in _listeners(timeline):
        for sent in recording.sent(topic):
            take(sent.value)
    for name, topic in PICTURES.items():
        for key in recording.keys_of(topic):
            for sample in recording.samples[key]:
                timeline.picture(name, StampedPicture(sample.stamp_ns, _loader(topic, sample)))
    if not len(timeline.joints):
        raise RecordingError(f"{path}: has no joint angles of an arm of {cell.workcell.arm().joints} joints to show")
    return ShownRecording(path, cell, timeline, (*notes, *recording.problems[:3]))


def _loader(topic: Topic[Image], sample: Recorded) -> Callable[[], Image]:
    def load() -> Image:
        return decode(topic.type, sample.payload, sample.label, sample.key)

    return load


__all__ = ["ContractError", "ShownRecording", "read_tape"]
