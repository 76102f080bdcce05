"""Read a recording back into typed messages, also one that a kill -9 or a power cut tore off.

A torn MCAP file has no footer and no index, and its last record may be cut; everything before that is whole. So a file
is always read from the front, record by record, up to its footer or to the tear.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Generic, TypeVar

from mcap.exceptions import McapError
from mcap.records import Channel, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from crosspih_common.bus.codec import decode
from crosspih_common.errors import ContractError, CrosspihError
from crosspih_common.keys import REFUSAL, ROOT, Command, Payload, Topic
from crosspih_common.messages import CommandRefusal
from crosspih_common.messages import Message as BusMessage

PayloadT = TypeVar("PayloadT", bound=Payload)
RequestT = TypeVar("RequestT", bound=BusMessage)
ReplyT = TypeVar("ReplyT", bound=BusMessage)
OVERTAKEN_NS = 50_000_000  # of the recorder's clock
# what a cut or garbled record raises somewhere below StreamReader
_TORN = (McapError, EOFError, struct.error, ValueError, UnicodeDecodeError, MemoryError, ZstdError, KeyError)


class RecordingError(CrosspihError):
    """A file is no recording, or cannot be read at all."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """One sample as it lies in the file: `stamp_ns` is the cell's clock, `wall_ns` the recorder's on arrival."""

    key: str
    label: str
    payload: bytes
    seq: int
    stamp_ns: int
    wall_ns: int


@dataclass(frozen=True, slots=True)
class Sent(Generic[PayloadT]):
    """A decoded sample and when it was recorded."""

    key: str
    value: PayloadT
    wall_ns: int


@dataclass(slots=True)
class Recording:
    """A recording in memory. `finished` is False for a torn file; `problems` says what could not be decoded."""

    path: Path
    finished: bool = False
    tear: str = ""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    samples: dict[str, list[Recorded]] = field(default_factory=dict)
    schemas: dict[str, tuple[str, str]] = field(default_factory=dict)  # key: (schema name, message encoding)
    problems: list[str] = field(default_factory=list)

    @property
    def cell(self) -> str:
        """The cell's name, from the metadata or else from the keys; empty when neither tells."""
        named = self.metadata.get("cell", {}).get("name", "")
        if named:
            return named
        return next((key.split("/")[1] for key in self.samples if key.startswith(f"{ROOT}/")), "")

    def keys_of(self, topic: Topic[Any]) -> list[str]:
        """The recorded keys of a topic: one, or one for each service."""
        parts = topic.path.split("/")
        found = []
        for key in self.samples:
            have = key.split("/")[2:]
            if len(have) == len(parts) and all(
                want in (got, "{service}") for want, got in zip(parts, have, strict=True)
            ):
                found.append(key)
        return sorted(found)

    def sent(self, topic: Topic[PayloadT]) -> list[Sent[PayloadT]]:
        """Every sample of a topic that decodes, key by key in the order of the file; the others go to `problems`."""
        values: list[Sent[PayloadT]] = []
        for key in self.keys_of(topic):
            for sample in self.samples[key]:
                try:
                    value = decode(topic.type, sample.payload, sample.label, key)
                except ContractError as error:
                    self.problems.append(str(error))
                    continue
                values.append(Sent(key, value, sample.wall_ns))
        return values

    def messages(self, topic: Topic[PayloadT]) -> list[PayloadT]:
        """Every message of a topic, as `sent` gives them."""
        return [entry.value for entry in self.sent(topic)]

    def last(self, topic: Topic[PayloadT]) -> PayloadT | None:
        """The last message of a topic, None when there is none."""
        messages = self.messages(topic)
        return messages[-1] if messages else None

    def answered(self, command: Command[RequestT, ReplyT]) -> list[tuple[Sent[RequestT], Sent[ReplyT] | None]]:
        """Each request of a command, in order, with its reply; None where none is recorded, as of one that was refused.

        What is recorded as refused (`refusals`) has none.

        A server answers one request after the other and repeats both on keys of their own, whose samples may overtake
        each other by a little: with as many replies as requests they belong together in order; else a reply belongs to
        the last request before it that has none, or to one that comes within `OVERTAKEN_NS`.
        """
        every, replies = self.sent(command.request_echo), self.sent(command.reply_echo)
        refused = self.refusals(command)
        requests = [request for request in every if request.value.seq not in refused]
        answers = dict(zip(map(id, requests), self._paired(requests, replies), strict=True))
        return [(request, answers.get(id(request))) for request in every]

    def refusals(self, command: Command[Any, Any]) -> dict[int, CommandRefusal]:
        """Why requests of a command were refused, by the `seq` of the request; empty in recordings of before."""
        said = [refusal for refusal in self.messages(REFUSAL) if refusal.command == command.path]
        return {refusal.request_seq: refusal for refusal in said if refusal.request_seq >= 0}

    @staticmethod
    def _paired(requests: list[Sent[RequestT]], replies: list[Sent[ReplyT]]) -> list[Sent[ReplyT] | None]:
        if len(requests) == len(replies):
            return list(replies)
        found: list[Sent[ReplyT] | None] = [None] * len(requests)
        after = 0  # whatever was asked before the last reply's request has had its turn
        for reply in replies:
            free = [index for index in range(after, len(requests)) if requests[index].wall_ns <= reply.wall_ns]
            if not free and after < len(requests) and requests[after].wall_ns <= reply.wall_ns + OVERTAKEN_NS:
                free = [after]
            if free:
                found[free[-1]], after = reply, free[-1] + 1
        return found

    def span_ns(self) -> tuple[int, int]:
        """(first, last) cell time in the file; (0, 0) when it is empty."""
        stamps = [sample.stamp_ns for samples in self.samples.values() for sample in samples]
        return (min(stamps), max(stamps)) if stamps else (0, 0)

    def seq_gaps(self) -> dict[str, int]:
        """Missing numbers between neighbours, key by key; a lower number is a publisher started again, not a gap."""
        gaps: dict[str, int] = {}
        for key, samples in self.samples.items():
            missing = sum(max(after.seq - before.seq - 1, 0) for before, after in pairwise(samples))
            if missing:
                gaps[key] = missing
        return gaps


def _records(reader: StreamReader, recording: Recording) -> Iterator[McapRecord]:
    try:
        yield from reader.records
    except _TORN as error:
        recording.tear = f"{type(error).__name__}: {error}".rstrip(": ")


def read_recording(path: str | Path, only: Iterable[Topic[Any]] | None = None) -> Recording:
    """Read a recording, whole or torn; with `only`, the samples of those topics alone.

    Raises RecordingError when the file cannot be opened or is no MCAP file.
    """
    recording = Recording(Path(path))
    wanted = None if only is None else {topic.path for topic in only}
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    any_record = False
    try:
        with recording.path.open("rb") as stream:
            # a garbled length must not ask for gigabytes
            limit = max(recording.path.stat().st_size, 1)
            for record in _records(StreamReader(stream, validate_crcs=True, record_size_limit=limit), recording):
                any_record = True
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Metadata):
                    recording.metadata[record.name] = dict(record.metadata)
                elif isinstance(record, Footer):
                    recording.finished = True
                elif isinstance(record, Message):
                    _take(record, channels, schemas, wanted, recording)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}); `crosspih assemble` names its file") from None
    if not any_record:
        raise RecordingError(f"{path}: is no MCAP file, or was torn before its first record ({recording.tear})")
    return recording


def _take(
    record: Message,
    channels: dict[int, Channel],
    schemas: dict[int, Schema],
    wanted: set[str] | None,
    recording: Recording,
) -> None:
    channel = channels.get(record.channel_id)
    if channel is None:
        return
    if wanted is not None and channel.metadata.get("path") not in wanted:
        return
    samples = recording.samples.get(channel.topic)
    if samples is None:
        samples = recording.samples[channel.topic] = []
        schema = schemas.get(channel.schema_id)
        recording.schemas[channel.topic] = (schema.name if schema else "", channel.message_encoding)
    label = f"{channel.metadata.get('label', '')} {record.sequence}"
    samples.append(Recorded(channel.topic, label, record.data, record.sequence, record.log_time, record.publish_time))


__all__ = ["OVERTAKEN_NS", "Recorded", "Recording", "RecordingError", "Sent", "read_recording"]
