"""Reports which service is lost while an assembly runs. It only reports; asking.py decides when to give up."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from crosspih_common.bus.workers import Pump
from crosspih_common.messages import Severity
from crosspih_common.service import ServiceContext

WAITING = 256


class MissedServices:
    """Follows the liveliness tokens of all other services of the cell.

    A token disappears within a second also when its service only hangs; on an overloaded machine this may happen by
    mistake. So it ends nothing: it publishes a warning `service_lost`, and `service_back` once the token is back.
    """

    def __init__(self, context: ServiceContext) -> None:
        self._context = context
        self._lock = threading.Lock()
        self._seen: set[str] = set()
        self._missing: set[str] = set()
        self._telling = False
        # a callback of the transport must return at once, but publishing may block
        self._changes: Pump[tuple[str, bool]] = Pump(
            self._change, WAITING, name="planning:missed", on_error=lambda error: None
        )
        context.bus.also_close(self._changes)
        context.bus.watch_alive(self._on_alive)

    def _on_alive(self, service: str, alive: bool) -> None:
        self._changes.offer((service, alive))

    def name(self, service: str, why: str) -> None:
        """Report a lost service, once."""
        with self._lock:
            if service in self._missing:
                return
            self._missing.add(service)
        self._context.event(Severity.WARNING, "service_lost", f"{service} is gone {why}")

    @contextmanager
    def reported(self) -> Iterator[None]:
        """Report losses for the length of a block; outside of it a service may be stopped on purpose."""
        with self._lock:
            self._telling = True
            self._missing.clear()
        try:
            yield
        finally:
            with self._lock:
                self._telling = False
                self._missing.clear()

    def _change(self, change: tuple[str, bool]) -> None:
        service, alive = change
        if service == self._context.name:
            return
        with self._lock:
            was_seen, was_missing = service in self._seen, service in self._missing
            (self._seen.add if alive else self._seen.discard)(service)
            if alive:
                self._missing.discard(service)
            told = self._telling
        if told and alive and was_missing:
            self._context.event(Severity.INFO, "service_back", f"{service} is back")
        elif told and not alive and was_seen:
            self.name(service, "in the middle of an assembly: no sign of life from it (its liveliness token went)")
