"""A new recording from the messages of others: byte for byte, each in its own channel."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel as McapChannel
from mcap.records import Schema as McapSchema
from mcap.writer import Writer

from crosspih_common.errors import ConfigError
from crosspih_common.recording.records import Attachment, Channel, Schema, sealed
from crosspih_common.recording.scanning import DEFINITIONS, LIBRARY
from crosspih_common.recording.walking import WalkedMessage

CHUNK_BYTES = 1 << 16
ITS_OWN = ("drops", "end")  # metadata that describe the file in which they are


class NewRecording:
    """A file being written; completed at the end of the block, removed when an error leaves the block.

    Raises ConfigError where the file already exists or cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.messages = 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = path.open("xb")
        except FileExistsError:
            raise ConfigError(f"{path}: is there already; name a file that is not") from None
        except OSError as error:
            raise ConfigError(f"{path}: cannot be made ({error.strerror})") from None
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES)
        self._writer.start(profile="", library=LIBRARY)
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channels: dict[tuple[str, str, int, tuple[tuple[str, str], ...]], int] = {}
        self._known: dict[tuple[int, int], int] = {}  # by the identity of the object that was read: fast
        self._kept_alive: list[tuple[Channel, Schema | None]] = []
        self._attached: set[tuple[str, bytes]] = set()
        self._repeat = RecordBuilder()

    def __enter__(self) -> NewRecording:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        if kind is not None:
            self._stream.close()
            self.path.unlink(missing_ok=True)
            return
        self._writer.flush()  # type: ignore[no-untyped-call]
        if self._repeat.count:
            data = zstandard.compress(self._repeat.end())  # type: ignore[no-untyped-call]
            self._writer.add_attachment(0, 0, DEFINITIONS, "application/zstd", data)
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def words(self, name: str, entries: Mapping[str, str]) -> None:
        """Add metadata, with a checksum."""
        self._writer.add_metadata(name, sealed(name, entries))

    def attach(self, attachment: Attachment) -> None:
        """Add an attachment, once; repeated definitions of channels are written anew."""
        if attachment.name != DEFINITIONS and (attachment.name, attachment.data) not in self._attached:
            self._attached.add((attachment.name, attachment.data))
            self._writer.add_attachment(
                attachment.create_time, attachment.log_time, attachment.name, attachment.media_type, attachment.data
            )

    def add(self, said: WalkedMessage) -> None:
        """Add a message."""
        entry = said.entry
        channel = self._known.get((id(said.channel), id(said.schema)))
        if channel is None:
            channel = self._register(said.channel, said.schema)
            self._known[id(said.channel), id(said.schema)] = channel
            self._kept_alive.append((said.channel, said.schema))
        self._writer.add_message(channel, entry.log_time, entry.data, entry.publish_time, entry.sequence)
        self.messages += 1

    def _register(self, channel: Channel, schema: Schema | None) -> int:
        number = 0
        if schema is not None:
            key = (schema.name, schema.encoding, schema.data)
            if key not in self._schemas:
                self._schemas[key] = self._writer.register_schema(*key)
                McapSchema(id=self._schemas[key], name=schema.name, encoding=schema.encoding, data=schema.data).write(
                    self._repeat
                )
            number = self._schemas[key]
        which = (channel.topic, channel.encoding, number, tuple(sorted(channel.metadata.items())))
        if which not in self._channels:
            words = dict(channel.metadata)
            made = self._writer.register_channel(channel.topic, channel.encoding, number, words)
            McapChannel(
                id=made, topic=channel.topic, message_encoding=channel.encoding, schema_id=number, metadata=words
            ).write(self._repeat)
            self._channels[which] = made
        return self._channels[which]
