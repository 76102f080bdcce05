"""Read a recording back into typed messages, also one that a kill -9 or a power cut left incomplete.

An incomplete (torn) MCAP file has no footer and no index, and its last record may be cut; everything before that is
intact. So a file is always read from the start, record by record, and damage is skipped (scanning.py). A recording may
have several files, its parts (parts.py): they are read as one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from crosspih_common.bus.codec import decode
from crosspih_common.errors import ContractError, CrosspihError
from crosspih_common.keys import ASSEMBLE, REFUSAL, ROOT, Command, Payload, Topic, topics
from crosspih_common.messages import AssemblyResult, CommandRefusal
from crosspih_common.messages import Message as BusMessage
from crosspih_common.recording.gaps import gap_matters
from crosspih_common.recording.numbering import Line
from crosspih_common.recording.parts import parts_of
from crosspih_common.recording.scanning import Damage
from crosspih_common.recording.viewers import for_viewers
from crosspih_common.recording.walking import ReadPart, Repeats, WalkedMessage, walk

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

PayloadT = TypeVar("PayloadT", bound=Payload)
RequestT = TypeVar("RequestT", bound=BusMessage)
ReplyT = TypeVar("ReplyT", bound=BusMessage)
OVERTAKEN_NS = 50_000_000  # of the recorder's clock
RATE_HZ = 1000.0  # the highest rate of any key


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


class Recording:
    """A recording in memory: `Recording("x.mcap")` reads it with all its parts, whole, torn or damaged.

    `finished` is False where a file of it is torn or damaged, and `tear` says how; `damage` is what lies within,
    `problems` say what could not be decoded. `samples` are by key, `schemas` too: (schema name, message encoding).
    """

    __slots__ = ("damage", "finished", "metadata", "parts", "path", "problems", "samples", "schemas", "shown", "tear")

    def __init__(self, path: str | Path, only: Iterable[Topic[Any]] | None = None) -> None:
        """With `only`, the samples of those topics alone.

        Raises RecordingError when its first file cannot be opened or is no MCAP file.
        """
        self._begin(Path(path))
        _read(self, only)

    def _begin(self, path: Path) -> None:
        self.path, self.finished, self.tear = path, False, ""
        self.parts: list[ReadPart] = []
        self.damage: list[Damage] = []
        self.metadata: dict[str, dict[str, str]] = {}
        self.samples: dict[str, list[Recorded]] = {}
        self.schemas: dict[str, tuple[str, str]] = {}
        self.shown: Counter[str] = Counter()  # number of messages for each viewer topic; their content is not read here
        self.problems: list[str] = []

    @classmethod
    def empty(cls, path: str | Path) -> Recording:
        """An empty recording with this name; no file is read."""
        recording = cls.__new__(cls)
        recording._begin(Path(path))
        return recording

    @property
    def cell(self) -> str:
        """The cell's name, from the metadata or else from the keys; empty if neither has it."""
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
        """Each request of a command, in order, with its reply; None if no reply is recorded, as for a refused request.

        Requests that are recorded as refused (`refusals`) have no reply.

        A server answers one request after the other and repeats request and reply on two keys, whose samples may
        overtake each other slightly. If there are as many replies as requests, they are paired in order. Else a reply
        belongs to the last request before it without a reply, or to one that comes within `OVERTAKEN_NS`.
        """
        every, replies = self.sent(command.request_echo), self.sent(command.reply_echo)
        refused = self.refusals(command)
        requests = [request for request in every if request.value.seq not in refused]
        answers = dict(zip(map(id, requests), self._paired(requests, replies), strict=True))
        return [(request, answers.get(id(request))) for request in every]

    def refusals(self, command: Command[Any, Any]) -> dict[int, CommandRefusal]:
        """Why requests of a command were refused, by the `seq` of the request; empty in old recordings."""
        said = [refusal for refusal in self.messages(REFUSAL) if refusal.command == command.path]
        return {refusal.request_seq: refusal for refusal in said if refusal.request_seq >= 0}

    @staticmethod
    def _paired(requests: list[Sent[RequestT]], replies: list[Sent[ReplyT]]) -> list[Sent[ReplyT] | None]:
        if len(requests) == len(replies):
            return list(replies)
        found: list[Sent[ReplyT] | None] = [None] * len(requests)
        after = 0  # requests before the one of the last reply are done
        for reply in replies:
            free = [index for index in range(after, len(requests)) if requests[index].wall_ns <= reply.wall_ns]
            if not free and after < len(requests) and requests[after].wall_ns <= reply.wall_ns + OVERTAKEN_NS:
                free = [after]
            if free:
                found[free[-1]], after = reply, free[-1] + 1
        return found

    def topics(self) -> tuple[str, ...]:
        """The paths of the topics that are recorded, below the cell's prefix, in order: "force_torque/wrench"."""
        return tuple(sorted({key.split("/", 2)[-1] for key in self.samples if key.startswith(f"{ROOT}/")}))

    def result(self) -> AssemblyResult | None:
        """The result of the last recorded assembly; None if there is none."""
        return self.last(ASSEMBLE.reply_echo)

    def to_pandas(self, topic: Topic[Any] | str) -> pandas.DataFrame:
        """A topic as a table, a row a sample: crosspih_common/recording/tables.py says how its columns are named.

        Raises ConfigError without pandas, and for a path that is no topic's or is not in this recording.
        """
        from crosspih_common.recording.tables import table_of

        return table_of(self, topic)

    def plot(self) -> Figure:
        """The last assembly's contact forces and moments against time, phases and touches marked (the paper's Figure
        19), as a matplotlib figure. Raises ConfigError without matplotlib, and where there is no wrench to draw."""
        from crosspih_common.recording.plotting import figure_of

        return figure_of(self)

    def span_ns(self) -> tuple[int, int]:
        """(first, last) cell time in the file; (0, 0) when it is empty."""
        stamps = [sample.stamp_ns for samples in self.samples.values() for sample in samples]
        return (min(stamps), max(stamps)) if stamps else (0, 0)

    def numbers(self) -> dict[str, Line]:
        """The sequence numbers of each key, as far as they are known; the file stores them with 32 bits."""
        lines: dict[str, Line] = {}
        for key, samples in self.samples.items():
            for sample in samples:
                if key not in lines:
                    lines[key] = Line(sample.seq + 1, sample.wall_ns * 1e-9)
                else:
                    lines[key].count_sample(sample.seq, sample.wall_ns * 1e-9, RATE_HZ)
        return lines

    def seq_gaps(self) -> dict[str, int]:
        """The number of missing samples of each key (numbering.py); a restart of a publisher is no gap."""
        return {key: missing for key, line in self.numbers().items() if (missing := line.missing())}

    def gaps_that_matter(self) -> dict[str, int]:
        """Those of `seq_gaps` that deserve a warning (gaps.py)."""
        kinds = {key: topic.kind for topic in topics() for key in self.keys_of(topic)}
        return {
            key: missing
            for key, missing in self.seq_gaps().items()
            if gap_matters(kinds.get(key), missing, len(self.samples[key]))
        }


def read_recording(path: str | Path, only: Iterable[Topic[Any]] | None = None) -> Recording:
    """`Recording(path, only)`."""
    return Recording(path, only)


def _read(recording: Recording, only: Iterable[Topic[Any]] | None) -> None:
    wanted = None if only is None else {topic.path for topic in only}
    repeats = Repeats()
    for file in parts_of(recording.path):
        part = ReadPart(file)
        repeats.begin_part()
        try:
            for said in walk(file, part):
                if for_viewers(said.channel.topic):
                    recording.shown[said.channel.topic] += 1
                elif (wanted is None or said.channel.metadata.get("path") in wanted) and not repeats.has(said):
                    _take(said, recording)
        except OSError as error:
            raise RecordingError(
                f"{file}: cannot be read ({error.strerror}); `crosspih assemble` names its file"
            ) from None
        if part.records == 0 and not recording.parts:
            why = part.damage[0].why if part.damage else "it is empty"
            raise RecordingError(f"{file}: is no MCAP file, or was torn before its first record ({why})")
        recording.parts.append(part)
    _sum_up(recording)


def _take(said: WalkedMessage, recording: Recording) -> None:
    channel, entry = said.channel, said.entry
    samples = recording.samples.get(channel.topic)
    if samples is None:
        samples = recording.samples[channel.topic] = []
        recording.schemas[channel.topic] = (said.schema.name if said.schema else "", channel.encoding)
    label = f"{channel.metadata.get('label', '')} {entry.sequence}"
    samples.append(Recorded(channel.topic, label, entry.data, entry.sequence, entry.log_time, entry.publish_time))


def _sum_up(recording: Recording) -> None:
    """Merge the parts: the metadata of the first, the sum of dropped samples, and whether each part is complete."""
    drops: Counter[str] = Counter()
    for part in recording.parts:
        for name, entries in part.metadata.items():
            if name == "drops":
                drops.update({key: int(value) for key, value in entries.items() if value.isdigit()})
            else:
                recording.metadata.setdefault(name, entries)
    if any("drops" in part.metadata for part in recording.parts):
        recording.metadata["drops"] = {key: str(count) for key, count in drops.items()}
    recording.finished = all(part.finished for part in recording.parts)
    recording.tear = "; ".join(
        part.tear if len(recording.parts) == 1 else f"{part.path.name}: {part.tear}"
        for part in recording.parts
        if not part.finished
    )
    recording.damage = [damage for part in recording.parts for damage in part.damage if not damage.torn]
    nameless = sum(part.nameless for part in recording.parts)
    if nameless:
        recording.problems.append(f"{nameless} messages whose key lay in what is damaged")


__all__ = ["OVERTAKEN_NS", "ReadPart", "Recorded", "Recording", "RecordingError", "Sent", "read_recording"]
