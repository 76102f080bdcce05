"""The commands of the page: sent as any other client sends them; each answer or refusal is put in words.

The page never holds the arm: the planner holds it while it carries out a command. Where somebody else holds it, the
page sends no command at all.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from crosspih_common.bus import Bus
from crosspih_common.errors import CommandRefused, CrosspihError
from crosspih_common.keys import ABORT, ASSEMBLE, PAUSE, RECORD_START, RECORD_STOP, RESET, WITHDRAW
from crosspih_common.messages import (
    AbortAssembly,
    Assemble,
    AssemblyResult,
    LeaseState,
    PauseAssembly,
    RecordingStatus,
    ResetCell,
    StartRecording,
    StopRecording,
    Strategy,
    Withdraw,
)

ASSEMBLY_DEADLINE_S = 900.0
WITHDRAW_DEADLINE_S = 300.0
RESET_DEADLINE_S = 120.0
NOW_DEADLINE_S = 5.0
RECORDER_DEADLINE_S, RECORDER_WAIT_S = 60.0, 1.0


@dataclass(frozen=True, slots=True)
class PageAnswer:
    """The outcome of a command in words; `good` is False where it was refused or failed."""

    good: bool
    text: str


def who_holds(lease: LeaseState | None) -> str:
    """Why no command may be sent to the arm now; empty where it is free."""
    if lease is None:
        return "nobody has told yet who holds the arm"
    if not lease.holder:
        return ""
    purpose = f" for {lease.purpose}" if lease.purpose else ""
    return f"{lease.holder} holds the arm{purpose}: this page leaves it alone until it is free"


class PageCommands:
    """Commands of the page, one at a time, except for stop and pause, which must pass the others."""

    def __init__(self, bus: Bus, lease: Callable[[], LeaseState | None], simulated: Callable[[], bool]) -> None:
        self._bus, self._lease, self._simulated = bus, lease, simulated
        self._busy = threading.Lock()

    @property
    def busy(self) -> str:
        """Why no command may be sent now; empty where one may."""
        return "what this page asked before is still under way" if self._busy.locked() else who_holds(self._lease())

    def assemble(self, strategy: Strategy, seed: int | None) -> PageAnswer:
        """One assembly, recorded. If there is a seed and the cell is simulated, a new trial begins before it."""
        return self._one_at_a_time(lambda: self._assemble(strategy, seed))

    def reset(self, seed: int) -> PageAnswer:
        """A new trial in the simulated cell."""
        return self._one_at_a_time(lambda: self._reset(seed))

    def withdraw(self) -> PageAnswer:
        """Take the seated peg straight out."""
        return self._one_at_a_time(self._withdraw)

    def stop(self) -> PageAnswer:
        """End the running assembly, whoever started it: the planner backs the peg off."""
        return _told(lambda: self._stop())

    def pause(self, paused: bool) -> PageAnswer:
        """Pause the running assembly before its next motion, or resume it."""
        return _told(lambda: self._pause(paused))

    def _one_at_a_time(self, ask: Callable[[], PageAnswer]) -> PageAnswer:
        if not self._busy.acquire(blocking=False):
            return PageAnswer(False, "what this page asked before is still under way")
        try:
            if held := who_holds(self._lease()):
                return PageAnswer(False, held)
            return _told(ask)
        finally:
            self._busy.release()

    def _assemble(self, strategy: Strategy, seed: int | None) -> PageAnswer:
        name = f"assembly-{strategy.value}"
        if seed is not None and self._simulated():
            self._bus.call(RESET, ResetCell(seed=seed), RESET_DEADLINE_S)
            name += f"-seed{seed}"
        recorded = self._record(name)
        try:
            request = Assemble(strategy=strategy, assembly_id=name)
            result = self._bus.call(ASSEMBLE, request, ASSEMBLY_DEADLINE_S)
        finally:
            kept = self._end_recording(recorded)
        return PageAnswer(result.inserted, f"{_how(result)}; {kept}")

    def _record(self, name: str) -> RecordingStatus | str:
        try:
            status = self._bus.call(RECORD_START, StartRecording(name=name), RECORDER_DEADLINE_S, RECORDER_WAIT_S)
        except CrosspihError as error:
            return str(error)
        return status if status.recording else status.trouble

    def _end_recording(self, recorded: RecordingStatus | str) -> str:
        if isinstance(recorded, str):
            return f"not recorded: {recorded}"
        try:
            status = self._bus.call(RECORD_STOP, StopRecording(), RECORDER_DEADLINE_S, RECORDER_WAIT_S)
        except CrosspihError as error:
            return f"recorded in {recorded.path}, whose end is missing: {error}"
        return "; ".join((f"recorded in {status.path}", *status.warnings))

    def _reset(self, seed: int) -> PageAnswer:
        if not self._simulated():
            return PageAnswer(False, "this cell is not simulated: it has no trials to start anew")
        self._bus.call(RESET, ResetCell(seed=seed), RESET_DEADLINE_S)
        return PageAnswer(True, f"a new trial, seed {seed}")

    def _withdraw(self) -> PageAnswer:
        out = self._bus.call(WITHDRAW, Withdraw(), WITHDRAW_DEADLINE_S)
        if out.failure is not None:
            return PageAnswer(False, f"not withdrawn: {out.failure.value} {out.failure_detail}")
        return PageAnswer(True, f"withdrawn, {out.distance_m * 1e3:.0f} mm, peak {out.peak_force_n:.1f} N")

    def _stop(self) -> PageAnswer:
        was_running = self._bus.call(ABORT, AbortAssembly(), NOW_DEADLINE_S).was_running
        said = "stopped: the peg is being backed off" if was_running else "no assembly runs: nothing to stop"
        return PageAnswer(was_running, said)

    def _pause(self, paused: bool) -> PageAnswer:
        accepted = self._bus.call(PAUSE, PauseAssembly(paused=paused), NOW_DEADLINE_S)
        if not accepted.was_running:
            return PageAnswer(False, "no assembly runs: nothing to hold")
        return PageAnswer(True, "held before its next motion" if accepted.paused else "going on")


def _how(result: AssemblyResult) -> str:
    if result.inserted:
        return f"inserted, {result.insertion_depth_m * 1e3:.1f} mm deep, {result.motion_s:.1f} s of motion"
    failed = "" if result.failure is None else f"{result.failure.value}: "
    return f"not inserted: {failed}{result.failure_detail}"


def _told(ask: Callable[[], PageAnswer]) -> PageAnswer:
    try:
        return ask()
    except CommandRefused as error:
        return PageAnswer(False, f"refused ({error.code}): {error.text}")
    except CrosspihError as error:
        return PageAnswer(False, str(error))
