"""One process of a running cell that a signal ends during an assembly, and its recovery."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress

from crosspih_common.errors import NoService
from deploy.launcher import ServiceRow, StateDirectory
from deploy.launcher.health import Health
from services.operator.assembly.session import Session
from services.operator.bench.reliability.kills.plan import ROUTER, KillCase, begins, ripe
from services.operator.bench.reliability.kills.watching import Watch

_POLL_S = 0.05


class Victim:
    """A service by its name, the router, or the process of an operator's command; each is ended once."""

    def __init__(self, session: Session, watch: Watch, name: str) -> None:
        self._session, self._watch, self.name = session, watch, name
        self._stack = StateDirectory(session.cell.workcell.name)
        self._pid: int | None = None

    def wait_ripe(self, moment: KillCase, over: Callable[[], bool], deadline_s: float) -> bool:
        """Wait for the moment of a case; returns whether it comes within the deadline and before the assembly is
        `over`.
        """
        watch = self._watch

        def now() -> bool:
            begun = any(begins(moment, phase) for phase in watch.phases)
            return begun and ripe(moment, watch.speed_rad_s, watch.force_n)

        until = time.monotonic() + deadline_s
        while not over() and time.monotonic() < until:
            if watch.wait(now, 1.0):
                return True
        return False

    def _row(self) -> ServiceRow:
        state = self._stack.read()
        if state is None:
            raise NoService("the launcher's state cannot be read: is the stack still up?")
        return next(row for row in state.services if row.service == self.name)

    def end(self, number: signal.Signals, pid: int | None = None) -> None:
        """Send it the signal: the watch's times count from here. `pid` is that of a process that the launcher does not
        know.

        Raises NoService where it does not run.
        """
        self._pid = self._row().pid if pid is None else pid
        if self._pid is None:
            raise NoService(f"{self.name}: not running, so it cannot be ended")
        self._watch.signalled(self.name)
        os.kill(self._pid, number)

    def then(self, number: signal.Signals) -> None:
        """Another signal to the same process: SIGCONT to a stopped one, or its end. A process that is
        gone gets none.
        """
        if self._pid is not None:
            with suppress(ProcessLookupError):
                os.kill(self._pid, number)

    def wait_healthy(self, deadline_s: float, same_process: bool = False) -> bool:
        """Whether in time the launcher has it healthy again and its token is there: as a process other than the ended
        one or, with `same_process`, also as that one. Raises NoService without a stack.
        """
        until = time.monotonic() + deadline_s
        while time.monotonic() < until:
            row = self._row()
            # the router has no token, but without a router nobody has one
            alive = self.name == ROUTER or self.name in self._session.alive()
            if alive and row.health is Health.HEALTHY and (same_process or row.pid not in (None, self._pid)):
                return True
            time.sleep(_POLL_S)
        return False

    def tip_before_m(self) -> float | None:
        """How far the peg's tip is before the hole's face by the latest truth, negative in the hole; None where the
        truth is of a new cell, whose arm was ended.
        """
        truth = self._watch.last_truth()
        if truth is None or self.name == "hardware":
            return None
        tip_m = self._session.cell.workcell.peg.shape().tip_m
        tip = truth.pose_base_hole.pose().inverse().apply(truth.pose_base_peg.pose().apply([0.0, 0.0, tip_m]))
        return -float(tip[2])
