"""How services are: state, counters, events."""

from __future__ import annotations

from enum import Enum
from typing import Annotated

from pydantic import AfterValidator, Field

from crosspih_common.messages.base import Message, Part
from crosspih_common.plain_text import plain

MAX_TEXT = 2000
# shown as it is, also by people's own programs
OneLine = Annotated[str, AfterValidator(lambda text: plain(text, MAX_TEXT))]


class ServiceState(str, Enum):
    """The life of a service."""

    STARTING = "starting"  # reading its configuration, opening its devices
    READY = "ready"  # answers commands, nothing under way
    ACTIVE = "active"  # a command is being carried out
    STOPPING = "stopping"  # closing what it opened
    FAILED = "failed"  # cannot go on; `last_error` says why


class KeyTraffic(Part):
    """Counts of one key since the service started, and its rate over the last second of wall time."""

    key: str
    out: int = 0
    received: int = 0
    dropped: int = 0
    rejected: int = 0
    out_hz: float = 0.0
    in_hz: float = 0.0


LAST_ERROR_S = 600.0  # for how long a service's last error is shown


class ServiceStatus(Message):
    """Sent once a second of wall time by every service."""

    service: str
    state: ServiceState
    reason: str = ""
    pid: int
    uptime_s: float
    traffic: tuple[KeyTraffic, ...] = ()
    rejected: int = 0
    dropped: int = 0
    last_error: str = Field(
        default="", description="the newest warning or error of the last 600 s; empty if there was none"
    )
    last_error_age_s: float | None = Field(default=None, ge=0.0, description="since then, wall time; None without one")
    host: str = Field(default="", description="the machine's name; empty in older recordings")
    wall_ns: int = Field(default=-1, description="that machine's wall clock when this was sent; -1: not known")
    wall_ahead_s: float | None = Field(
        default=None, description="of the wall clock of the cell's machine; None: not known"
    )
    wall_bound_s: float | None = Field(default=None, description="bound of the error of wall_ahead_s")


class Severity(str, Enum):
    """How loud an event is."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class Event(Message):
    """Something that people should know of: a named code and one line."""

    service: OneLine
    severity: Severity
    code: OneLine
    text: OneLine = Field(max_length=MAX_TEXT)


class CommandRefusal(Message):
    """A command that a service refused, with the words that its caller was given: what a recording cannot tell else."""

    command: str = Field(description="the command's path below the cell's prefix")
    request_seq: int = Field(
        default=-1, description="the `seq` of the request as it was repeated; -1 where it was not even read"
    )
    refused: str = Field(description="the code, for programs (docs/wire.md)")
    text: str
