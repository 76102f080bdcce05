"""Which messages viewers get: the open channels, the last message of each, and who subscribes. Knows no WebSocket."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Protocol

from crosspih_common.bus.codec import encode
from crosspih_common.config import Workcell
from crosspih_common.foxglove import FoxgloveTopics, ViewerTopic
from crosspih_common.foxglove.own_messages import channel_schema
from crosspih_common.keys import Kind, Topic


class ViewerChannel(Protocol):
    """Takes the messages of one topic."""

    def log(self, msg: bytes, *, log_time: int | None = None) -> None:
        """Send the next message; `log_time` is the cell's, ns."""


# name, (schema name, schema encoding, message encoding, schema), description
Open = Callable[[str, tuple[str, str, str, bytes], str], ViewerChannel]


class ViewerMessages:
    """Turns messages of the bus into messages for viewers. Any thread may call it.

    Streams are converted only while somebody subscribes. All other messages are always converted, so that a viewer who
    subscribes late gets the current state (`asked`, then `catch_up`).
    """

    def __init__(self, workcell: Workcell, cell: str, rate_hz: float, open_channel: Open) -> None:
        self._cell, self._open = cell, open_channel
        self._channels: dict[str, ViewerChannel] = {}
        self._last: dict[str, tuple[bytes, int]] = {}
        self._looked_at: dict[str, int] = {}  # number of subscribers of each topic
        self._asked: set[str] = set()
        self._lock = threading.Lock()
        self._topics = FoxgloveTopics(workcell, self._tell, rate_hz)

    def take(self, topic: Topic[Any], value: Any) -> None:
        """Convert one message of a topic: as it is, and as the viewers' topics that follow from it."""
        with self._lock:
            if topic.kind is Kind.STREAM and not self._looked_at:
                return
            name = topic.key(self._cell, getattr(value, "service", "*"))
            self._log(name, channel_schema(topic.type), topic.doc, encode(value), value.stamp_ns, topic.kind)
            self._topics.take(topic, value)

    def _tell(self, topic: ViewerTopic, stamp_ns: int, data: bytes) -> None:
        self._log(topic.name, topic.channel_schema(), topic.doc, data, stamp_ns, topic.kind)

    def _log(
        self, name: str, schema: tuple[str, str, str, bytes], doc: str, data: bytes, stamp_ns: int, kind: Kind
    ) -> None:
        channel = self._channels.get(name)
        if channel is None:
            channel = self._channels[name] = self._open(name, schema, doc)
        if kind is not Kind.STREAM:
            self._last[name] = data, stamp_ns
        channel.log(data, log_time=max(stamp_ns, 0))

    def looks(self, name: str) -> None:
        """Somebody subscribes to the topic."""
        with self._lock:
            self._looked_at[name] = self._looked_at.get(name, 0) + 1
            self._asked.add(name)

    def looks_away(self, name: str) -> None:
        """Somebody unsubscribes from the topic."""
        with self._lock:
            left = self._looked_at.get(name, 0) - 1
            if left > 0:
                self._looked_at[name] = left
            else:
                self._looked_at.pop(name, None)

    def catch_up(self) -> None:
        """Send the current state on the topics that were subscribed to since the last call."""
        with self._lock:
            asked, self._asked = self._asked, set()
            for name in asked:
                if name in self._last:
                    data, stamp_ns = self._last[name]
                    self._channels[name].log(data, log_time=max(stamp_ns, 0))
