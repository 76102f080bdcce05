"""The kinds of keys of the bus: a topic with samples, or a command with a server. The keys are in keys.py."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeAlias, TypeVar

from crosspih_common.messages import Image, Message

ROOT = "crosspih"
RECORDED = ("recorder",)
SHOWN = ("operator", *RECORDED)  # users of crosspih_common/client act as the operator

Payload: TypeAlias = Message | Image
PayloadT = TypeVar("PayloadT", bound=Payload)
RequestT = TypeVar("RequestT", bound=Message)
ReplyT = TypeVar("ReplyT", bound=Message)


class Kind(str, Enum):
    """The kind of a topic: how long a sample stays valid, and whether a loss matters."""

    STREAM = "stream"  # a value that ages: the newest matters, a lost one is dropped
    STATE = "state"  # the last value stays true until the next: late readers get it
    EVENT = "event"  # each one matters: recovered when lost


class Qos(str, Enum):
    """Quality of service: whether lost samples are recovered."""

    DROP = "drop"  # best for streams: a slow reader never holds up the publisher
    RECOVER = "recover"  # cached by the publisher, misses found by heartbeat and fetched again


@dataclass(frozen=True, slots=True)
class Topic(Generic[PayloadT]):
    """A key with samples. `path` stands below `crosspih/<cell>/`; `{service}` is filled in by the sender's name.

    `readers` are the services that subscribe to it; a test compares them with the code. Readers of recordings do not
    count.
    """

    path: str
    type: type[PayloadT]
    kind: Kind
    publisher: str
    readers: tuple[str, ...]
    doc: str
    rate_hz: float | None = None

    @property
    def qos(self) -> Qos:
        """Streams drop, states and events recover."""
        return Qos.DROP if self.kind is Kind.STREAM else Qos.RECOVER

    def key(self, cell: str, service: str = "*") -> str:
        """The full key, or with `service` left out the expression for all services."""
        return f"{ROOT}/{cell}/{self.path.format(service=service)}"


@dataclass(frozen=True, slots=True)
class Command(Generic[RequestT, ReplyT]):
    """A key with a server that answers each query once, or refuses with a reason.

    `callers` are the services that send it; a test compares them with the code. A command that changes a calibration
    is answered to these only: its sender must have claimed one of their names (crosspih_common/bus/authors.py).
    """

    path: str
    request: type[RequestT]
    reply: type[ReplyT]
    server: str
    callers: tuple[str, ...]
    doc: str
    changes_calibration: bool = False

    def key(self, cell: str) -> str:
        """The full key."""
        return f"{ROOT}/{cell}/{self.path}"

    @property
    def request_echo(self) -> Topic[RequestT]:
        """The topic on which the server repeats each request."""
        return Topic(f"{self.path}/request", self.request, Kind.EVENT, self.server, RECORDED, f"asked: {self.doc}")

    @property
    def reply_echo(self) -> Topic[ReplyT]:
        """The topic on which the server repeats each reply."""
        return Topic(f"{self.path}/reply", self.reply, Kind.EVENT, self.server, SHOWN, f"answered: {self.doc}")
