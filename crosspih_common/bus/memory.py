"""The bus in memory: the same interface, the same codec, one process. For unit tests."""

from __future__ import annotations

import queue
import re
import threading
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field

from crosspih_common.bus.transport import Answer, AuthoredHandler, Closeable, Query, Sender
from crosspih_common.errors import BusClosed, CommandTimeout, NoService


def _matcher(key_expression: str) -> re.Pattern[str]:
    parts = []
    for part in key_expression.split("/"):
        parts.append({"*": "[^/]+", "**": ".*"}.get(part, re.escape(part)))
    return re.compile("/".join(parts) + r"\Z")


class _Undo:
    def __init__(self, undo: Callable[[], None]) -> None:
        self._undo: Callable[[], None] | None = undo

    def close(self) -> None:
        undo, self._undo = self._undo, None
        if undo is not None:
            undo()


@dataclass(eq=False)
class _Subscription:
    pattern: re.Pattern[str]
    handler: AuthoredHandler


@dataclass(eq=False)
class _Watcher:
    pattern: re.Pattern[str]
    handler: Callable[[str, bool], None]


class _MemoryQuery:
    def __init__(self, payload: bytes, label: str, author: str) -> None:
        self.payload = payload
        self.label = label
        self.author = author
        self.answers: queue.Queue[Answer] = queue.Queue()

    def answer(self, answer: Answer) -> None:
        self.answers.put(answer)


@dataclass(eq=False)
class MemoryHub:
    """The state that all transports of one test share. Call `transport()` of one hub for each service."""

    lock: threading.RLock = field(default_factory=threading.RLock)
    subscriptions: list[_Subscription] = field(default_factory=list)
    handlers: dict[str, list[AuthoredHandler]] = field(default_factory=dict)  # by key, for the present subscriptions
    servers: dict[str, Callable[[Query], None]] = field(default_factory=dict)
    tokens: list[str] = field(default_factory=list)
    watchers: list[_Watcher] = field(default_factory=list)
    kept: dict[str, tuple[bytes, str, str]] = field(default_factory=dict)
    served: threading.Condition = field(default_factory=threading.Condition)

    def transport(self) -> MemoryTransport:
        """A transport of this hub."""
        return MemoryTransport(self)

    def put(self, key: str, payload: bytes, label: str, keep: bool, author: str = "") -> None:
        """Deliver to every matching subscription, in the caller's thread."""
        with self.lock:
            if keep:
                self.kept[key] = (payload, label, author)
            matching = self.handlers_of(key)
        for handler in matching:
            handler(key, payload, label, author)

    def handlers_of(self, key: str) -> list[AuthoredHandler]:
        """The handlers that the present subscriptions call with each sample of a key."""
        with self.lock:
            matching = self.handlers.get(key)
            if matching is None:
                matching = [entry.handler for entry in self.subscriptions if entry.pattern.match(key)]
                self.handlers[key] = matching
            return matching

    def turn(self, key: str, alive: bool) -> None:
        """A liveliness token comes or goes."""
        with self.lock:
            if alive:
                self.tokens.append(key)
            elif key in self.tokens:
                self.tokens.remove(key)
            handlers = [watcher.handler for watcher in self.watchers if watcher.pattern.match(key)]
        for handler in handlers:
            handler(key, alive)


class _MemorySender:
    def __init__(self, transport: MemoryTransport, key: str, keep: bool) -> None:
        self._transport, self._key, self._keep = transport, key, keep

    def put(self, payload: bytes, label: str) -> None:
        if self._transport.closed:
            raise BusClosed("cannot publish: the bus is closed")
        self._transport.hub.put(self._key, payload, label, self._keep, self._transport.author)

    def close(self) -> None:
        pass


class MemoryTransport:
    """One service's side of a MemoryHub. See Transport for each method."""

    endpoint: str | None = None

    def __init__(self, hub: MemoryHub) -> None:
        self.hub = hub
        self.author = uuid.uuid4().hex
        self.closed = False
        self._undo: list[Closeable] = []

    def _declared(self, undo: Callable[[], None]) -> Closeable:
        entry = _Undo(undo)
        self._undo.append(entry)
        return entry

    def sender(self, key: str, *, recover: bool, history: int) -> Sender:
        """Declare a publisher."""
        return _MemorySender(self, key, keep=recover)

    def subscribe(self, key_expression: str, handler: AuthoredHandler, *, recover: bool) -> Closeable:
        """Call the handler with every sample, kept ones first where `recover`."""
        entry = _Subscription(_matcher(key_expression), handler)
        with self.hub.lock:
            self.hub.subscriptions.append(entry)
            self.hub.handlers.clear()
            kept = [(key, *value) for key, value in self.hub.kept.items() if entry.pattern.match(key)]
        if recover:
            for key, payload, label, author in kept:
                handler(key, payload, label, author)

        def undo() -> None:
            with self.hub.lock:
                if entry in self.hub.subscriptions:
                    self.hub.subscriptions.remove(entry)
                    self.hub.handlers.clear()

        return self._declared(undo)

    def wait_served(self, key: str, wait_s: float) -> bool:
        """See Transport."""
        with self.hub.served:
            return self.hub.served.wait_for(lambda: key in self.hub.servers, max(wait_s, 0.0))

    def query(self, key: str, payload: bytes, label: str, deadline_s: float) -> Answer:
        """Ask and wait."""
        with self.hub.lock:
            server = self.hub.servers.get(key)
        if server is None:
            raise NoService(f"{key}: nobody answers; is the service that serves it up? (`crosspih ps`)")
        query = _MemoryQuery(payload, label, self.author)
        server(query)
        try:
            return query.answers.get(timeout=deadline_s)
        except queue.Empty:
            raise CommandTimeout(f"{key}: no answer within {deadline_s:g} s") from None

    def serve(self, key: str, handler: Callable[[Query], None]) -> Closeable:
        """Call the handler with every query."""
        with self.hub.served:
            self.hub.servers[key] = handler
            self.hub.served.notify_all()
        return self._declared(lambda: self.hub.servers.pop(key, None) and None)

    def declare_alive(self, key: str) -> Closeable:
        """A liveliness token."""
        self.hub.turn(key, True)
        return self._declared(lambda: self.hub.turn(key, False))

    def claim(self, key: str) -> Closeable:
        """A liveliness token too."""
        return self.declare_alive(key)

    def living(self, key_expression: str) -> list[str]:
        """The tokens that there are."""
        pattern = _matcher(key_expression)
        with self.hub.lock:
            return [key for key in self.hub.tokens if pattern.match(key)]

    def watch_alive(self, key_expression: str, handler: Callable[[str, bool], None]) -> Closeable:
        """Tokens coming and going."""
        watcher = _Watcher(_matcher(key_expression), handler)
        with self.hub.lock:
            self.hub.watchers.append(watcher)
            present = [key for key in self.hub.tokens if watcher.pattern.match(key)]
        for key in present:
            handler(key, True)

        def undo() -> None:
            with self.hub.lock:
                if watcher in self.hub.watchers:
                    self.hub.watchers.remove(watcher)

        return self._declared(undo)

    def close(self) -> None:
        """Withdraw all declarations."""
        if not self.closed:
            self.closed = True
            for entry in reversed(self._undo):
                entry.close()
