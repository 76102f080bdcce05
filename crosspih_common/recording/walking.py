"""Every message of a file with its channel, in file order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from crosspih_common.recording.records import Attachment, Channel, Entry, Metadata, Schema
from crosspih_common.recording.scanning import Damage, scanning

_BARE = (Schema, Channel, Entry)


@dataclass(slots=True)
class ReadPart:
    """One file of a recording, filled while it is walked through.

    `declared` is the number of messages according to its summary; `nameless` are intact messages whose channel
    definition was in a damaged part.
    """

    path: Path
    finished: bool = False
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    unsealed: list[str] = field(default_factory=list)  # metadata without a check of its own
    attachments: list[Attachment] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)
    is_mcap: bool = False
    records: int = 0
    messages: int = 0
    nameless: int = 0
    declared: int | None = None
    size: int = 0

    @property
    def tear(self) -> str:
        """What is wrong with the file; empty for a complete one."""
        if self.finished:
            return ""
        return "; ".join(map(str, self.damage)) or "it has no end: the recorder was killed or the disk failed"


@dataclass(frozen=True, slots=True)
class WalkedMessage:
    """One message, its channel and that one's schema."""

    channel: Channel
    schema: Schema | None
    entry: Entry


def walk(path: Path, part: ReadPart) -> Iterator[WalkedMessage]:
    """The messages of one file, without damaged ones; other information goes to `part`. Raises OSError."""
    with scanning(path) as scan:
        part.size, part.is_mcap = scan.size, scan.is_mcap
        part.declared = None if scan.summary is None else scan.summary.messages
        definitions = scan.learn_definitions()
        for found in scan:
            if isinstance(found, Damage):
                part.damage.append(found)
                continue
            part.records += 1
            content = found.content
            if isinstance(content, Metadata):
                part.metadata[content.name] = content.entries
                if not content.sealed:
                    part.unsealed.append(content.name)
            elif isinstance(content, Attachment):
                part.attachments.append(content)
            for record in (content,) if isinstance(content, _BARE) else found.records:
                if not isinstance(record, Entry):
                    definitions.add(record)
                    continue
                channel = definitions.channels.get(record.channel_id)
                if channel is None:
                    part.nameless += 1
                    continue
                part.messages += 1
                yield WalkedMessage(channel, definitions.schemas.get(channel.schema_id), record)
        part.finished = scan.summary is not None and scan.ended and not part.damage


class Repeats:
    """Detects what a new part repeats from the one before: known states, and each service's last event."""

    def __init__(self) -> None:
        self._last: dict[str, Entry] = {}
        self._first_here: set[str] = set()

    def begin_part(self) -> None:
        """A new file begins."""
        self._first_here = set(self._last)

    def has(self, said: WalkedMessage) -> bool:
        """Whether this is the last message of its key again."""
        key, entry = said.channel.topic, said.entry
        if key in self._first_here:
            self._first_here.discard(key)
            last = self._last[key]
            same = (last.sequence, last.log_time, last.data) == (entry.sequence, entry.log_time, entry.data)
            if same:
                return True
        self._last[key] = entry
        return False
