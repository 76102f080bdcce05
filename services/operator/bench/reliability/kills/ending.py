"""Ends one service in one phase of an assembly, in a worker's own cell, and observes the effects."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator
from typing import Any

from crosspih_common.client.running_recording import RECORDER_DEADLINE_S
from crosspih_common.errors import CrosspihError, NoService
from crosspih_common.keys import ASSEMBLE, RECORD_START
from crosspih_common.messages import Assemble, AssemblyResult, ResetCell, StartRecording
from services.operator.assembly.session import NEEDED, Session
from services.operator.bench.reliability.kills.judging import NAMED_S, Observed, stopped_after_s
from services.operator.bench.reliability.kills.plan import KillCase, ServiceEnding
from services.operator.bench.reliability.kills.victim import Victim
from services.operator.bench.reliability.kills.watching import Watch

RIPE_DEADLINE_S = 120.0
END_DEADLINE_S = 240.0
STOPPED_FOR_S = 6.0  # when a stopped planner goes on: after its link is cut, or once the arm has dropped it
RESTART_DEADLINE_S = 120.0
NAMED_LATE_S = 1.0  # extra wait, to distinguish a late message from none


def end_service(session: Session, payload: dict[str, Any]) -> dict[str, Any]:
    """The work of a CellTask: `payload` is a Case, the result an Observed, both as plain data."""
    case = KillCase.model_validate(payload)
    session.new_trial(ResetCell(seed=case.seed))
    # messages of this case alone
    with _hearing_in_time(), Session() as own:
        own.wait_for_services(RESTART_DEADLINE_S, (*NEEDED, "recorder"))
        return _Run(own, case).run().model_dump(mode="json")


@contextlib.contextmanager
def _hearing_in_time() -> Iterator[None]:
    """Raises the priority of the calling thread and of those that begin in it, where the system grants it: the time at
    which the cell's stamps are received is part of every time that is measured here.
    """
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
        # a stack that this process starts later must not inherit it
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class _Run:
    def __init__(self, session: Session, case: KillCase) -> None:
        self._session, self._case = session, case
        self._watch = Watch(session)
        self._victim = Victim(session, self._watch, case.service)
        self._result: AssemblyResult | None = None
        self._told = ""
        self._ended = threading.Event()

    def run(self) -> Observed:
        """End the service, and make sure that the cell is complete again afterwards."""
        if self._case.service == "recorder":
            self._session.bus.call(RECORD_START, StartRecording(name="kills"), RECORDER_DEADLINE_S)
        asker = threading.Thread(target=self._ask, name="asker", daemon=True)
        asker.start()
        watch, victim, ending = self._watch, self._victim, self._case.ending
        if not victim.wait_ripe(self._case, self._ended.is_set, RIPE_DEADLINE_S):
            asker.join(END_DEADLINE_S)
            return self._observed(None, moving=False, force_n=0.0)
        moving, force_n = watch.speed_rad_s > 0.0, watch.force_n
        victim.end(ending.number)
        try:
            if self._case.service == "planning":
                watch.wait(lambda: watch.let_go_ns is not None and watch.outcome is not None, STOPPED_FOR_S)
                if ending is ServiceEnding.STOP:
                    victim.then(signal.SIGCONT)
            asker.join(END_DEADLINE_S)
            ended_s = watch.since_signal_s()
            # the loss of a hanging service may be noticed only after the assembly, which did not need it
            watch.wait(lambda: watch.named is not None, max(NAMED_S + NAMED_LATE_S - ended_s, 0.0))
            return self._observed(ended_s, moving, force_n)
        finally:
            if ending is ServiceEnding.STOP:
                # the next case needs a service that is idle
                victim.then(signal.SIGKILL)
            if not victim.wait_healthy(RESTART_DEADLINE_S):
                raise NoService(f"{self._case.service}: not started again within {RESTART_DEADLINE_S:g} s")

    def _ask(self) -> None:
        try:
            request = Assemble(strategy=self._case.strategy, assembly_id=self._case.name)
            self._result = self._session.bus.call(ASSEMBLE, request, END_DEADLINE_S)
        except CrosspihError as error:
            self._told = f"{type(error).__name__}: {error}"
        finally:
            self._ended.set()

    def _observed(self, ended_s: float | None, moving: bool, force_n: float) -> Observed:
        watch, result = self._watch, self._result
        if ended_s is None:
            detail = self._told or ("" if result is None else f"inserted {result.inserted} {result.failure_detail}")
            return Observed(signalled=False, detail=detail)
        if self._told and self._case.service in self._told:
            watch.reported_by_asker()
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
            done_reported=watch.done_reported(),
            ended_s=ended_s if self._ended.is_set() else None,
            peak_n=watch.peak_n(),
            tip_before_m=self._victim.tip_before_m(),
        )
