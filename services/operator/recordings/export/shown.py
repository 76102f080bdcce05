"""The topics for viewers, made from the messages of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crosspih_common.bus.codec import decode
from crosspih_common.config import CellFile, cell_of_text
from crosspih_common.errors import ConfigError, ContractError
from crosspih_common.foxglove import HEARD, TRUTH_HEARD, FoxgloveTopics, ViewerTopic
from crosspih_common.keys import Topic
from crosspih_common.recording import Recording

EVERY: tuple[Topic[Any], ...] = (*HEARD, *TRUTH_HEARD)
RATE_HZ = 50.0


@dataclass(frozen=True, slots=True)
class ViewerMessage:
    """One message for viewers: `stamp_ns` is the cell's clock, `wall_ns` the recorder's when its source
    message came.
    """

    topic: ViewerTopic
    stamp_ns: int
    wall_ns: int
    data: bytes


def shown_of(recording: Recording, rate_hz: float = RATE_HZ) -> Iterator[ViewerMessage]:
    """Every message, in the order of their sources. What cannot be decoded is listed in `recording.problems`.

    Raises ConfigError where the recording names no cell.
    """
    cell = cell_of(recording)
    made: list[tuple[ViewerTopic, int, bytes]] = []
    topics = FoxgloveTopics(cell.workcell, lambda topic, stamp_ns, data: made.append((topic, stamp_ns, data)), rate_hz)
    samples = [
        (sample, topic) for topic in EVERY for key in recording.keys_of(topic) for sample in recording.samples[key]
    ]
    for sample, topic in sorted(samples, key=lambda entry: entry[0].wall_ns):
        if not topics.wants(topic, sample.stamp_ns):
            continue
        try:
            topics.take(topic, decode(topic.type, sample.payload, sample.label, sample.key))
        except ContractError as error:
            recording.problems.append(str(error))
        yield from (ViewerMessage(told, stamp_ns, sample.wall_ns, data) for told, stamp_ns, data in made)
        made.clear()


def cell_of(recording: Recording) -> CellFile:
    """The cell, from its file in the recording. Raises ConfigError."""
    said = recording.metadata.get("cell", {})
    if "yaml" not in said:
        raise ConfigError(f"{recording.path}: holds no cell file, so nothing is known of its arm")
    return cell_of_text(Path(said.get("path") or recording.path), said["yaml"])
