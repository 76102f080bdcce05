"""The interface between the typed bus and the transport of its bytes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

Tap = Callable[[bytes, int], None]  # payload, number; -1 for a sample without one
AuthoredHandler = Callable[
    [str, bytes, str, str], None
]  # key, payload, label, session it comes from; empty where it does not say


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to a query: a reply, or a typed error."""

    payload: bytes
    label: str
    is_error: bool


class Query(Protocol):
    """A received query; it is answered exactly once, from any thread."""

    payload: bytes
    label: str
    author: str

    def answer(self, answer: Answer) -> None:
        """Send the one answer."""


class Closeable(Protocol):
    """Something declared on the transport."""

    def close(self) -> None:
        """Withdraw the declaration."""


class Sender(Closeable, Protocol):
    """A declared publisher of one key."""

    def put(self, payload: bytes, label: str) -> None:
        """Send one sample; `label` names its type and version."""


class Transport(Protocol):
    """Carries bytes. Handlers are called on the transport's threads and must only enqueue.

    `endpoint` is the router, or None where the bus is in memory. `author` is this session's name, which travels with
    whatever it sends.
    """

    endpoint: str | None
    author: str

    def sender(self, key: str, *, recover: bool, history: int) -> Sender:
        """Declare a publisher; with `recover` missed samples are fetched again, `history` kept for late readers."""

    def subscribe(self, key_expression: str, handler: AuthoredHandler, *, recover: bool) -> Closeable:
        """Call the handler with every sample."""

    def wait_served(self, key: str, wait_s: float) -> bool:
        """Whether the key has a server, waiting for one up to `wait_s`. Raises BusClosed."""

    def query(self, key: str, payload: bytes, label: str, deadline_s: float) -> Answer:
        """Ask and wait. Raises NoService when nobody answers, CommandTimeout at the deadline."""

    def serve(self, key: str, handler: Callable[[Query], None]) -> Closeable:
        """Call the handler with every query."""

    def declare_alive(self, key: str) -> Closeable:
        """Show that this process lives, until it is closed, dies or hangs."""

    def claim(self, key: str) -> Closeable:
        """As `declare_alive`, but tied to the session that publishes: the claim ends with that session."""

    def living(self, key_expression: str) -> list[str]:
        """The keys of all present tokens."""

    def watch_alive(self, key_expression: str, handler: Callable[[str, bool], None]) -> Closeable:
        """Call with (key, True) for each that lives or comes, (key, False) for each that goes."""

    def close(self) -> None:
        """Withdraw all declarations; safe to call twice."""
