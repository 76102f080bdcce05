"""Reports the refusals of a secure router, from Zenoh's log, as events on the bus and as lines of the service's log."""

from __future__ import annotations

import contextlib
import os
import queue
import sys
import threading
import time

import zenoh

from crosspih_common.bus import Bus
from crosspih_common.bus.zenoh_transport import ZenohTransport
from crosspih_common.errors import BusError
from crosspih_common.keys import EVENTS
from crosspih_common.messages import Event, Severity
from services.router.refusals_log import LEVELS, RefusalEvent, RefusalsLog

AGAIN_S = 10.0  # the same refusal is reported again only after this time
PIPE_BYTES = 1 << 20  # buffer while Python is busy: Zenoh blocks when it is full
READ_BYTES = 1 << 16
WAITING = 256
REMEMBERED = 1000
WORDS = (b"unauthorized", b"WARN", b"ERROR", b"caching", b"CertCommonName")  # other lines are not parsed


class Telling:
    """Zenoh logs to standard output. This takes it over before Zenoh starts; this process's own prints are not
    affected.
    """

    def __init__(self) -> None:
        self._log, self._said = RefusalsLog(), dict[RefusalEvent, float]()
        self._found: queue.Queue[RefusalEvent] = queue.Queue(WAITING)
        reading, writing = os.pipe()
        with contextlib.suppress(ImportError, AttributeError, OSError):
            import fcntl

            fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        sys.stdout.flush()
        # this process prints on the old standard output, Zenoh on the pipe
        sys.stdout = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
        os.dup2(writing, 1)
        os.close(writing)
        os.environ["RUST_LOG"] = LEVELS
        os.environ["NO_COLOR"] = "1"
        zenoh.try_init_log_from_env()
        threading.Thread(target=self._read, args=(reading,), name="zenoh-log", daemon=True).start()

    def _read(self, reading: int) -> None:
        rest = b""
        while chunk := os.read(reading, READ_BYTES):
            *lines, rest = (rest + chunk).split(b"\n")
            for line in lines:
                if any(word in line for word in WORDS):
                    self._look(line.decode(errors="replace"))

    def _look(self, line: str) -> None:
        refused = self._log.read(line)
        if refused is not None:
            now = time.monotonic()
            if now - self._said.get(refused, -AGAIN_S) >= AGAIN_S:
                if len(self._said) >= REMEMBERED:
                    self._said.clear()
                self._said[refused] = now
                with contextlib.suppress(queue.Full):
                    self._found.put_nowait(refused)
        elif " ERROR " in line or " WARN " in line:
            print(line, file=sys.stderr, flush=True)

    def to(self, session: zenoh.Session, endpoint: str, cell: str) -> Bus:
        """Report refusals on the bus of a cell; the caller closes the bus."""
        bus = Bus(ZenohTransport(session, endpoint), cell, "router")
        threading.Thread(target=self._tell, args=(bus,), name="refusals", daemon=True).start()
        return bus

    def _tell(self, bus: Bus) -> None:
        while True:
            refused = self._found.get()
            print(f"warning: {refused.code}: {refused.text}", file=sys.stderr, flush=True)
            event = Event(service="router", severity=Severity.WARNING, code=refused.code, text=refused.text[:2000])
            with contextlib.suppress(BusError):
                bus.publisher(EVENTS).publish(event)
