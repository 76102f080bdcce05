"""Start a service, publish its status, end it cleanly.

`python -m services.<name>` calls `run_service(name, Config, build)`. `build` gets a context with the bus, and the
service's own section of the cell's file as a `Config`; it binds the service's core to its keys, and returns what must
be closed at the end (or None).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import FrameType
from typing import Protocol, TypeVar

from crosspih_common.bus import DEFAULT_ENDPOINT, Bus, open_zenoh
from crosspih_common.config import CellFile, Section, load_cell
from crosspih_common.errors import CONFIG_STATUS, BusError, ConfigError, CrosspihError
from crosspih_common.keys import EVENTS, STATUS, WALL_CLOCK
from crosspih_common.messages import Event, ServiceState, ServiceStatus, Severity
from crosspih_common.messages.status import LAST_ERROR_S, MAX_TEXT
from crosspih_common.modules import DEFAULT_CELL
from crosspih_common.plain_text import plain
from crosspih_common.service import notify
from crosspih_common.service.wall_clock import ClockOffset, ClockWatch, this_host
from crosspih_common.service.works import Works, end_hard_after

STATUS_PERIOD_S = 1.0
SECOND_WAITS_S = 7.0  # how long to wait for the name: that of a lost machine is free after the link's lease
SectionT = TypeVar("SectionT", bound=Section)


class ServiceResource(Protocol):
    """Something that a service opened and must close (protocol)."""

    def close(self) -> None:
        """Close it."""


@dataclass(eq=False)
class ServiceContext:
    """The context of a service: its bus, its cell and its status."""

    name: str
    cell: CellFile
    bus: Bus
    stop: threading.Event = field(default_factory=threading.Event)
    state: ServiceState = ServiceState.STARTING
    reason: str = ""
    works: Works = field(init=False)
    clocks: ClockWatch | None = None  # None in the hardware service, whose wall clock is the reference
    _last_error: tuple[float, str] = (-math.inf, "")
    _started_at: float = field(default_factory=time.monotonic)
    _said_at: dict[str, float] = field(default_factory=dict)  # code: when it was last published

    def __post_init__(self) -> None:
        self.works = Works(self.bus.duties)

    @property
    def last_error(self) -> str:
        """The newest warning or error, for LAST_ERROR_S; then empty again."""
        at, text = self._last_error
        return text if time.monotonic() - at <= LAST_ERROR_S else ""

    @last_error.setter
    def last_error(self, text: str) -> None:
        self._last_error = (time.monotonic(), plain(text, MAX_TEXT))

    def event(self, severity: Severity, code: str, text: str) -> None:
        """Publish an event on the bus and print it on standard error; one line, because part of it may be untrusted."""
        text = plain(text, MAX_TEXT)
        if severity is not Severity.INFO:
            self.last_error = f"{code}: {text}"
        print(f"{severity.value}: {code}: {text}", file=sys.stderr, flush=True)
        with contextlib.suppress(BusError):
            self.bus.publisher(EVENTS).publish(Event(service=self.name, severity=severity, code=code, text=text))

    def fail(self, reason: str) -> None:
        """The service cannot go on: publish the reason and end with status 1."""
        self.state, self.reason = ServiceState.FAILED, plain(reason, MAX_TEXT)
        self.event(Severity.ERROR, "failed", reason)
        self.stop.set()

    def status(self) -> ServiceStatus:
        """The present status of the service."""
        state = self.state
        if state is ServiceState.READY and self.bus.busy:
            state = ServiceState.ACTIVE
        traffic = self.bus.traffic
        wall = self.wall_difference
        return ServiceStatus(
            service=self.name,
            state=state,
            reason=self.reason,
            pid=os.getpid(),
            uptime_s=round(time.monotonic() - self._started_at, 3),
            traffic=traffic.snapshot(),
            rejected=traffic.total("rejected"),
            dropped=traffic.total("dropped"),
            last_error=(last_error := self.last_error),
            last_error_age_s=round(time.monotonic() - self._last_error[0], 3) if last_error else None,
            host=this_host(),
            wall_ns=time.time_ns(),
            wall_ahead_s=None if wall is None else wall.offset_s,
            wall_bound_s=None if wall is None else wall.bound_s,
        )

    @property
    def wall_difference(self) -> ClockOffset | None:
        """How far this machine's wall clock is from that of the cell's machine, where it is known."""
        return None if self.clocks is None else self.clocks.difference

    def watch_clocks(self) -> None:
        """Start to compare this machine's wall clock with that of the cell's machine; publish a change."""

        def tell(apart: bool, found: ClockOffset) -> None:
            if apart:
                said = f"{found}: log times differ by that, stamps do not; set both by NTP (docs/several-machines.md)"
                self.event(Severity.WARNING, "clocks_apart", said)
            else:
                self.event(Severity.INFO, "clocks_together", str(found))

        if self.name != WALL_CLOCK.server:
            self.clocks = ClockWatch(self.bus, tell)
            self.bus.also_close(self.clocks)


def _arguments(name: str, argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=f"python -m services.{name}", description=f"The {name} service.")
    parser.add_argument("--cell", default=os.environ.get("CROSSPIH_CELL") or DEFAULT_CELL, help="the cell's YAML file")
    parser.add_argument(
        "--endpoint", default=os.environ.get("CROSSPIH_ENDPOINT") or DEFAULT_ENDPOINT, help="the router"
    )
    parser.add_argument(
        "--check-config", action="store_true",
        help="only say, as JSON, whether the service's section of the cell's file can be read, and its settings",
    )  # fmt: skip
    return parser.parse_args(argv)


def check_config(path: str, section: str, model: type[Section]) -> int:
    """Print {"ok": true, "settings": the section with its defaults} or {"ok": false, "wrong": why}; the exit status."""
    try:
        settings = load_cell(path).section(section, model)
    except ConfigError as error:
        print(json.dumps({"ok": False, "wrong": str(error)}))
        return 1
    print(json.dumps({"ok": True, "settings": settings.model_dump(mode="json")}))
    return 0


def run_service(
    name: str,
    model: type[SectionT],
    build: Callable[[ServiceContext, SectionT], ServiceResource | None],
    argv: Sequence[str] | None = None,
    section: str | None = None,
) -> int:
    """Run a service until SIGINT, SIGTERM or its own failure; returns the exit status, CONFIG_STATUS where the cell's
    file, its own section in it or the router's address is at fault.

    Its section of the cell's file has its name where `section` gives no other. `--check-config`: see `check_config`.
    """
    arguments = _arguments(name, argv)
    section = section or name
    if arguments.check_config:
        return check_config(arguments.cell, section, model)
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    try:
        cell = load_cell(arguments.cell)
        transport = open_zenoh(arguments.endpoint, service=name)
    except CrosspihError as error:
        print(f"{name}: {error}", file=sys.stderr, flush=True)
        return CONFIG_STATUS if isinstance(error, ConfigError) else 1
    with Bus(transport, cell.workcell.name, name, claim=False) as bus:
        context = ServiceContext(name, cell, bus, stop)
        bus.on_reject = lambda why: _report_rejection(context, "rejected", why)
        bus.on_forged = lambda why: _report_rejection(context, "forged_state", why)
        try:
            claim = bus.authors.claim_alone(name, SECOND_WAITS_S, stop)
        except BusError as error:
            print(f"{name}: {error}", file=sys.stderr, flush=True)
            return 1
        if claim is None:
            context.event(
                Severity.ERROR, "second_service", f"{name} runs already in cell {bus.cell}; end that one first"
            )
            return 1
        bus.also_close(claim)
        status = bus.publisher(STATUS)
        status.publish(context.status())
        opened: ServiceResource | None = None
        settings: SectionT | None = None
        try:
            settings = cell.section(section, model)
            opened = build(context, settings)
            if not stop.is_set():
                context.state = ServiceState.READY
                bus.declare_alive()
                status.publish(context.status())
                notify.ready()
                context.watch_clocks()
            while not stop.wait(STATUS_PERIOD_S):
                bus.authors.tell_of_held()
                if trouble := context.works.feed():
                    end_hard_after()
                    context.fail(f"does not work any more: {trouble}")
                status.publish(context.status())
        except CrosspihError as error:
            context.fail(str(error))
        except Exception as error:
            traceback.print_exc()
            context.fail(f"{type(error).__name__}: {error}")
        failed = context.state is ServiceState.FAILED
        if not failed:
            context.state = ServiceState.STOPPING
        with contextlib.suppress(BusError):
            status.publish(context.status())
        if opened is not None:
            opened.close()
    return 0 if not failed else CONFIG_STATUS if settings is None else 1


def _report_rejection(context: ServiceContext, code: str, why: str) -> None:
    """Publish at most one event per code and second, on a separate thread (this is a bus callback); all are counted."""
    now = time.monotonic()
    context.last_error = why
    if now - context._said_at.get(code, 0.0) >= 1.0:
        context._said_at[code] = now
        threading.Thread(
            target=context.event, args=(Severity.WARNING, code, why), name="rejection", daemon=True
        ).start()
