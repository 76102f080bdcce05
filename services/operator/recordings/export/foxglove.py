"""`crosspih recording export foxglove`: a recording with topics in Foxglove's well-known schemas beside its own."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.foxglove import ViewerTopic, arm_urdf
from crosspih_common.recording import Recording, read_recording
from crosspih_common.recording.records import Attachment, Channel, Entry, Schema
from crosspih_common.recording.viewers import URDF, for_viewers
from crosspih_common.recording.walking import ReadPart, WalkedMessage
from services.operator.bench.options import errors_shown
from services.operator.recordings.export.shown import EVERY, RATE_HZ, ViewerMessage, cell_of, shown_of
from services.operator.recordings.making import messages_in
from services.operator.recordings.writing import NewRecording

METADATA = "foxglove"


def foxglove(
    recording: Annotated[Path, typer.Argument(help="A recording (.mcap), also a torn or damaged one.")],
    out: Annotated[Path, typer.Argument(help="The recording that is made (.mcap).")],
    rate_hz: Annotated[float, typer.Option(min=1.0, max=500.0, help="Of frames and joints.")] = RATE_HZ,
) -> None:
    """Write a recording with topics for Foxglove, Lichtblick and Rerun: of one that has none, or made anew."""
    console = Console()
    with errors_shown(console):
        read = read_recording(recording, EVERY)
        counts = add_topics(read, out, rate_hz)
        for line in read.problems[:5]:
            console.print(f"left out: {line}", highlight=False, markup=False)
        for name, count in sorted(counts.items()):
            console.print(f"{count:8d}  {name}", highlight=False)


def add_topics(recording: Recording, out: Path, rate_hz: float = RATE_HZ) -> Counter[str]:
    """Copy a recording without its topics for viewers, and add these anew; returns how many messages each of them has.

    Raises ConfigError where the recording names no cell, or `out` cannot be made; RecordingError.
    """
    urdf = arm_urdf(cell_of(recording).workcell).encode()
    counts: Counter[str] = Counter()
    with NewRecording(out) as new:
        parts: list[ReadPart] = []
        for said in messages_in(recording.path, parts):
            if not for_viewers(said.channel.topic):
                new.add(said)
        records: dict[ViewerTopic, tuple[Channel, Schema]] = {}
        for shown in shown_of(recording, rate_hz):
            if shown.topic not in records:
                records[shown.topic] = _records_of(shown.topic)
            new.add(_said(shown, *records[shown.topic], counts[shown.topic.name]))
            counts[shown.topic.name] += 1
        for part in parts:
            for attachment in part.attachments:
                if attachment.name != URDF:
                    new.attach(attachment)
            for name, entries in part.metadata.items():
                if name != METADATA:
                    new.words(name, entries)
        new.attach(Attachment(0, 0, URDF, "application/xml", urdf))
        new.words(METADATA, {"messages": str(counts.total()), "not_shown": "0", "failed": str(len(recording.problems))})
    return counts


def _records_of(topic: ViewerTopic) -> tuple[Channel, Schema]:
    name, encoding, message_encoding, data = topic.channel_schema()
    words = {"kind": topic.kind.value, "for": "viewers", "doc": topic.doc}
    return Channel(0, topic.name, message_encoding, 0, words), Schema(0, name, encoding, data)


def _said(shown: ViewerMessage, channel: Channel, schema: Schema, number: int) -> WalkedMessage:
    return WalkedMessage(channel, schema, Entry(0, number & 0xFFFFFFFF, shown.stamp_ns, shown.wall_ns, shown.data))
