"""Keeps a lease by beats from a separate process.

A thread of the holder is not enough. With eight busy processes on two cores, and GIL-heavy work in its own process, a
thread that beats every 20 ms was silent for up to 1.1 s, a separate process for 36 ms. So a small process takes the
lease, beats, and gives it back. It stops beating when its parent is gone or stopped (SIGKILL, SIGSTOP).
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import subprocess
import threading
from typing import Any, Protocol
from weakref import WeakKeyDictionary

from crosspih_common import errors
from crosspih_common.bus import Bus
from crosspih_common.errors import BusClosed, BusError, CommandRefused, NoService
from crosspih_common.holding.heart import Heart
from crosspih_common.messages import LeaseGranted
from crosspih_common.modules import module_command

START_DEADLINE_S = 60.0  # an interpreter starts slowly on a busy machine
ANSWER_DEADLINE_S = 15.0
END_DEADLINE_S = 2.0


_making = threading.Lock()
_pulses: WeakKeyDictionary[Bus, Pulse] = WeakKeyDictionary()


class Pulse(Protocol):
    """Takes the lease, beats while its owner lives, gives the lease back."""

    def take(self, purpose: str) -> LeaseGranted:
        """Take the lease and start to beat. Raises CommandRefused `held`, BusError."""

    def give(self) -> bool:
        """Stop beating and give the lease back. Returns whether it was still held. Raises BusError."""

    def close(self) -> None:
        """Stop beating; a lease that was not given back ends by its time-out."""


class PulseProcess:
    """Beats over a Zenoh session of its own. Starts at once; the first `take` waits for it."""

    def __init__(self, endpoint: str, cell: str, service: str) -> None:
        self._lock = threading.Lock()
        self._closed = False
        self._command = module_command("crosspih_common.holding.beating", endpoint, cell, service, str(os.getpid()))
        self._start()

    def _start(self) -> None:
        # a session of its own: a Ctrl-C is for the parent, which may still have a peg to take out
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            start_new_session=True,
        )
        self._said: queue.Queue[str] = queue.Queue()
        self._ready = False
        self._reader = threading.Thread(target=self._read, args=(self._process, self._said), name="pulse", daemon=True)
        self._reader.start()

    @staticmethod
    def _read(process: subprocess.Popen[str], said: queue.Queue[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            said.put(line)
        said.put("")

    def take(self, purpose: str) -> LeaseGranted:
        """See Pulse."""
        with self._lock:
            if self._closed:
                raise BusClosed("the arm cannot be held: the bus is closed")
            if self._process.poll() is not None:
                self._end()
                self._start()
            if not self._ready:
                self._answer(START_DEADLINE_S)
                self._ready = True
            return LeaseGranted.model_validate(self._ask({"take": purpose})["granted"])

    def give(self) -> bool:
        """See Pulse."""
        with self._lock:
            return bool(self._ask({"give": True})["was_held"])

    def _ask(self, what: dict[str, Any]) -> dict[str, Any]:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(what) + "\n")
            self._process.stdin.flush()
        except (OSError, ValueError) as error:  # broken, or closed with the bus
            raise NoService(f"the process that beats for the lease is gone: {error}") from None
        return self._answer(ANSWER_DEADLINE_S)

    def _answer(self, deadline_s: float) -> dict[str, Any]:
        try:
            line = self._said.get(timeout=deadline_s)
        except queue.Empty:
            self._end()
            raise NoService(f"the process that beats for the lease said nothing for {deadline_s:g} s") from None
        if not line:
            raise NoService("the process that beats for the lease ended; its standard error says why")
        answer: dict[str, Any] = json.loads(line)
        if "refused" in answer:
            raise CommandRefused(answer["refused"], answer["text"])
        if "error" in answer:
            kind = getattr(errors, answer["error"], BusError)
            raise kind(answer["text"])
        return answer

    def _end(self) -> None:
        assert self._process.stdin is not None and self._process.stdout is not None
        with contextlib.suppress(OSError):  # the process was gone before all input was sent
            self._process.stdin.close()
        try:
            self._process.wait(END_DEADLINE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(END_DEADLINE_S)
        self._process.stdout.close()

    def close(self) -> None:
        """See Pulse."""
        with self._lock:
            self._closed = True
            self._end()


def pulse_of(bus: Bus) -> Pulse:
    """The beats of this bus's service, started at the first call and ended with the bus. They come from a separate
    process, or from a thread if the bus is in memory (then the arm is in the same process)."""
    with _making:
        if bus not in _pulses:
            pulse: Pulse = Heart(bus) if bus.endpoint is None else PulseProcess(bus.endpoint, bus.cell, bus.service)
            bus.also_close(pulse)
            _pulses[bus] = pulse
        return _pulses[bus]
