"""Ends one service in one phase of an assembly, in a worker's own cell, and observes what becomes of it."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

from crosspih_common.errors import CrosspihError, NoService
from crosspih_common.keys import ASSEMBLE, RECORD_START
from crosspih_common.messages import Assemble, AssemblyResult, ResetCell, StartRecording
from deploy.launcher import ServiceState, StateDirectory
from deploy.launcher.health import Health
from services.operator.bench.kills.judging import NAMED_S, Observed, stopped_after_s
from services.operator.bench.kills.plan import Case, Ending, begins, ripe
from services.operator.bench.kills.watching import Watch
from services.operator.recorded import RECORDER_DEADLINE_S
from services.operator.session import NEEDED, Session

RIPE_DEADLINE_S = 120.0
END_DEADLINE_S = 240.0
STOPPED_FOR_S = 6.0  # a planner that hangs goes on after so long, its link then cut, or once the arm let go of it
RESTART_DEADLINE_S = 120.0
NAMED_LATE_S = 1.0  # waited on, so that a late word is told from none
_POLL_S = 0.05


def end_service(session: Session, payload: dict[str, Any]) -> dict[str, Any]:
    """The work of a CellTask: `payload` is a Case, the result an Observed, both as plain data."""
    case = Case.model_validate(payload)
    session.reset(ResetCell(seed=case.seed))
    # what is heard of this case, and of no other
    with _hearing_in_time(), Session() as own:
        own.wait_for_services(RESTART_DEADLINE_S, (*NEEDED, "recorder"))
        return _Run(own, case).run().model_dump(mode="json")


@contextlib.contextmanager
def _hearing_in_time() -> Iterator[None]:
    """Ahead of all that computes, where the system grants it, for the calling thread and those that begin in it: how
    late the cell's stamps are heard is in every time that is measured here."""
    if not hasattr(os, "SCHED_RR"):
        yield
        return
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    except OSError:
        yield
        return
    try:
        yield
    finally:
        # what this process starts later is a stack, and must not be so
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class _Run:
    def __init__(self, session: Session, case: Case) -> None:
        self._session, self._case = session, case
        self._stack = StateDirectory(session.cell.workcell.name)
        self._watch = Watch(session)
        self._result: AssemblyResult | None = None
        self._told = ""
        self._ended = threading.Event()

    def run(self) -> Observed:
        """End the service, and see to it that the cell is whole again afterwards."""
        if self._case.service == "recorder":
            self._session.bus.call(RECORD_START, StartRecording(name="kills"), RECORDER_DEADLINE_S)
        asker = threading.Thread(target=self._ask, name="asker", daemon=True)
        asker.start()
        if not self._wait_ripe():
            asker.join(END_DEADLINE_S)
            return self._observed(None, moving=False, force_n=0.0)
        pid = self._row().pid
        if pid is None:
            raise NoService(f"{self._case.service}: not running, so it cannot be ended")
        watch = self._watch
        moving, force_n = watch.speed_rad_s > 0.0, watch.force_n
        watch.signalled(self._case.service)
        os.kill(pid, self._case.ending.number)
        try:
            if self._case.service == "planning":
                watch.wait(lambda: watch.let_go_ns is not None and watch.outcome is not None, STOPPED_FOR_S)
                if self._case.ending is Ending.STOP:
                    os.kill(pid, signal.SIGCONT)
            asker.join(END_DEADLINE_S)
            ended_s = watch.since_signal_s()
            # one that hangs may be missed only after the assembly, which did not need it
            watch.wait(lambda: watch.named is not None, max(NAMED_S + NAMED_LATE_S - ended_s, 0.0))
            return self._observed(ended_s, moving, force_n)
        finally:
            if self._case.ending is Ending.STOP:
                # the next case wants one that has nothing left to do
                os.kill(pid, signal.SIGKILL)
            self._wait_restarted(pid)

    def _ask(self) -> None:
        try:
            request = Assemble(strategy=self._case.strategy, assembly_id=self._case.name)
            self._result = self._session.bus.call(ASSEMBLE, request, END_DEADLINE_S)
        except CrosspihError as error:
            self._told = f"{type(error).__name__}: {error}"
        finally:
            self._ended.set()

    def _wait_ripe(self) -> bool:
        watch, case = self._watch, self._case

        def phase_begun() -> bool:
            return any(begins(case, phase) for phase in watch.phases)

        until = time.monotonic() + RIPE_DEADLINE_S
        while not self._ended.is_set() and time.monotonic() < until:
            if watch.wait(lambda: phase_begun() and ripe(case, watch.speed_rad_s, watch.force_n), 1.0):
                return True
        return False

    def _row(self) -> ServiceState:
        state = self._stack.read()
        if state is None:
            raise NoService("the launcher's state cannot be read: is the stack still up?")
        return next(row for row in state.services if row.service == self._case.service)

    def _wait_restarted(self, old_pid: int) -> None:
        until = time.monotonic() + RESTART_DEADLINE_S
        while (row := self._row()).pid in (None, old_pid) or row.health is not Health.HEALTHY:
            if time.monotonic() > until:
                raise NoService(f"{self._case.service}: not started again within {RESTART_DEADLINE_S:g} s")
            time.sleep(_POLL_S)

    def _observed(self, ended_s: float | None, moving: bool, force_n: float) -> Observed:
        watch, result = self._watch, self._result
        if ended_s is None:
            detail = self._told or ("" if result is None else f"inserted {result.inserted} {result.failure_detail}")
            return Observed(signalled=False, detail=detail)
        if self._told and self._case.service in self._told:
            watch.told_by_asker()
        stop_s = beats_s = None
        if self._case.service == "planning":
            with contextlib.suppress(ValueError):
                until_ns = watch.broken_off_ns() or watch.let_go_ns
                stop_s = stopped_after_s(*watch.joints_until(until_ns), watch.signal_ns)
                beats_s = (watch.gone_ns - watch.signal_ns) * 1e-9
        named_s, named_by = watch.named or (None, "")
        return Observed(
            signalled=True,
            moving=moving,
            force_n=force_n,
            stop_s=stop_s,
            beats_s=beats_s,
            stop_reason=watch.stop_reason(),
            named_s=named_s,
            named_by=named_by,
            inserted=result is not None and result.inserted,
            failure=None if result is None else result.failure,
            detail="" if result is None else result.failure_detail,
            asker_told=self._told,
            backed_off=result is not None and result.backed_off,
            done_told=watch.done_told(),
            ended_s=ended_s if self._ended.is_set() else None,
            peak_n=watch.peak_n(),
            tip_before_m=self._tip_before_m(),
        )

    def _tip_before_m(self) -> float | None:
        truth = self._watch.last_truth()
        if truth is None or self._case.service == "hardware":
            return None
        tip_m = self._session.cell.workcell.peg.shape().tip_m
        tip = truth.pose_base_hole.pose().inverse().apply(truth.pose_base_peg.pose().apply([0.0, 0.0, tip_m]))
        return -float(tip[2])
