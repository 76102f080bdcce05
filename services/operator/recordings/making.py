"""Recordings made from others: the sound part of a damaged one, a section of one, several as one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from crosspih_common.errors import ConfigError
from crosspih_common.keys import ASSEMBLE, Kind
from crosspih_common.recording import RecordingError, parts_of, read_recording
from crosspih_common.recording.rerun import begun_ns
from crosspih_common.recording.viewers import URDF
from crosspih_common.recording.walking import ReadPart, Repeats, WalkedMessage, walk
from services.operator.recordings.writing import ITS_OWN, NewRecording


@dataclass(frozen=True, slots=True)
class MadeRecording:
    """The file that was written, and its sources; `repeated` counts the messages that came more than once."""

    messages: int
    parts: list[ReadPart]
    repeated: int = 0


def messages_in(path: Path, parts: list[ReadPart]) -> Iterator[WalkedMessage]:
    """The messages of all parts of a recording, without those that a new part repeats; appends to `parts`.

    Raises RecordingError.
    """
    repeats = Repeats()
    for file in parts_of(path):
        part = ReadPart(file)
        parts.append(part)
        repeats.begin_part()
        try:
            for said in walk(file, part):
                if not repeats.has(said):
                    yield said
        except OSError as error:
            raise RecordingError(f"{file}: cannot be read ({error.strerror})") from None


def recover(path: Path, out: Path) -> MadeRecording:
    """Write every undamaged message, byte for byte as it was, into a sound file.

    Raises RecordingError for a file that is no MCAP file and has no undamaged message, ConfigError for `out`.
    """
    parts: list[ReadPart] = []
    with NewRecording(out) as new:
        for said in messages_in(path, parts):
            new.add(said)
        if not any(part.is_mcap or part.records for part in parts):
            raise RecordingError(f"{path}: is no MCAP file, and nothing in it is whole")
        for part in parts:
            for attachment in part.attachments:
                new.attach(attachment)
        _words(new, parts, ())
        new.words("recovered", {"of": path.name, "parts": str(len(parts)), "messages": str(new.messages)})
        return MadeRecording(new.messages, parts)


def _words(new: NewRecording, parts: Sequence[ReadPart], leave_out: tuple[str, ...]) -> None:
    """The metadata of the first part that has them, and the drops of all parts."""
    drops: Counter[str] = Counter()
    written: set[str] = set()
    for part in parts:
        for name, entries in part.metadata.items():
            if name in leave_out:
                continue
            if name == "drops":
                drops.update({key: int(value) for key, value in entries.items() if value.isdigit()})
            elif name not in written:
                written.add(name)
                new.words(name, entries)
    if any("drops" in part.metadata for part in parts) and "drops" not in leave_out:
        new.words("drops", {key: str(count) for key, count in drops.items()})


@dataclass(frozen=True, slots=True)
class RecordedAssembly:
    """One assembly in a recording, cell time; `end_ns` is None where its result is not in it."""

    number: int
    name: str
    start_ns: int
    end_ns: int | None


def assemblies_in(path: Path) -> tuple[int, int, list[RecordedAssembly]]:
    """(when the recording began, its last stamp, its assemblies in order), cell time. Raises RecordingError."""
    recording = read_recording(path)
    found = [
        RecordedAssembly(
            number,
            request.value.assembly_id,
            request.value.stamp_ns,
            None if reply is None else reply.value.stamp_ns,
        )
        for number, (request, reply) in enumerate(recording.answered(ASSEMBLE), start=1)
    ]
    return begun_ns(recording), recording.span_ns()[1], found


def window(path: Path, from_s: float | None, to_s: float | None, assembly: str | None) -> tuple[int, int]:
    """(first, last) stamp of the section to cut out, ns of cell time. Raises ConfigError, RecordingError."""
    start_ns, last_ns, found = assemblies_in(path)
    if assembly is None:
        first = start_ns if from_s is None else start_ns + round(from_s * 1e9)
        last = (1 << 63) - 1 if to_s is None else start_ns + round(to_s * 1e9)
        if from_s is None:
            first = 0  # states from before the recording began belong to its beginning
        if first >= last:
            raise ConfigError(f"--from {from_s} --to {to_s}: nothing lies between")
        return first, last
    for one in found:
        if assembly in (str(one.number), one.name):
            return one.start_ns, last_ns if one.end_ns is None else one.end_ns
    names = ", ".join(f"{one.number} ({one.name})" if one.name else str(one.number) for one in found)
    raise ConfigError(f"--assembly {assembly}: {path} has {names or 'none'}")


def cut(path: Path, out: Path, first_ns: int, last_ns: int) -> MadeRecording:
    """Write everything between two stamps, preceded by the states that were known at the first one.

    Raises RecordingError, ConfigError.
    """
    known: dict[str, WalkedMessage] = {}
    for said in messages_in(path, []):
        if said.channel.metadata.get("kind") == Kind.STATE.value and said.entry.log_time < first_ns:
            known[said.channel.topic] = said
    parts: list[ReadPart] = []
    with NewRecording(out) as new:
        for said in known.values():
            new.add(said)
        for said in messages_in(path, parts):
            if first_ns <= said.entry.log_time <= last_ns:
                new.add(said)
        for part in parts:
            for attachment in part.attachments:
                if attachment.name == URDF:
                    new.attach(attachment)
        _words(new, parts, ITS_OWN)
        new.words("cut", {"of": path.name, "first_ns": str(first_ns), "last_ns": str(last_ns)})
        return MadeRecording(new.messages, parts)


def merge(paths: Sequence[Path], out: Path) -> MadeRecording:
    """Write several recordings, each with its parts, as one by log time; a message that is in more than one is written
    once.

    Raises RecordingError, ConfigError.
    """
    parts: list[ReadPart] = []
    every: list[WalkedMessage] = []
    for path in paths:
        before = len(every)
        every += messages_in(path, parts)
        if len(every) == before:
            raise RecordingError(f"{path}: holds no whole message; nothing was merged")
    every.sort(key=lambda said: said.entry.log_time)
    seen: set[tuple[str, int, int, bytes]] = set()
    with NewRecording(out) as new:
        for said in every:
            entry = said.entry
            which = (said.channel.topic, entry.sequence, entry.log_time, entry.data)
            if which not in seen:
                seen.add(which)
                new.add(said)
        for part in parts:
            for attachment in part.attachments:
                new.attach(attachment)
        _words(new, parts, ("end",))
        new.words("merged", {str(number): str(part.path.name) for number, part in enumerate(parts, start=1)})
        return MadeRecording(new.messages, parts, len(every) - new.messages)
