"""Requests an assembly and always ends with a result, even if the planner or the router dies meanwhile.

The answer of a query is lost when the planner ends (killed or stopped), when the router ends, or when the link is cut
while the planner hangs. The outcome is then on the bus: a living planner publishes its answer on its own topic when it
is done, and a planner that is started in its place publishes what it found. So the operator keeps listening, lets the
new planner take the peg out, and returns a result that names what is known.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from crosspih_common.bus import Bus, Latest
from crosspih_common.errors import STOPPING, CommandRefused, CrosspihError, NoService, NotSent
from crosspih_common.keys import (
    ADMITTANCE_MOVE,
    ASSEMBLE,
    DWELL,
    EVENTS,
    FOLLOW,
    GUARDED_MOVE,
    MOVE_LINEAR,
    REFUSAL,
    STATUS,
    TOUCH,
    WITHDRAW,
    Command,
)
from crosspih_common.messages import (
    Assemble,
    AssemblyResult,
    CommandRefusal,
    Event,
    Failure,
    Message,
    MotionOutcome,
    ServiceState,
    ServiceStatus,
    Severity,
    Withdraw,
)

PLANNER = "planning"
BACK_S = 60.0  # how long to wait for a silent planner or its successor
FOUND_S = 120.0  # how long to wait for the successor's findings: it starts a process of its own to hold the arm
LATE_S = 5.0  # a planner that is ready again has answered; the answer may be on its way for this long
YOUNGER_S = 1.0  # a successor has been running for less than the age of the request by at least this much
WITHDRAW_DEADLINE_S = 300.0
FOUND = ("peg_found", "arm_found", "peg_unknown")
HEARD: tuple[Command[Any, Any], ...] = (ASSEMBLE, DWELL, FOLLOW, MOVE_LINEAR, GUARDED_MOVE, ADMITTANCE_MOVE)
KEPT = 4096
_POLL_S = 0.1


def ask_assembly(
    bus: Bus, request: Assemble, deadline_s: float, say: Callable[[str], object] = lambda text: None
) -> AssemblyResult:
    """Ask the planner for an assembly. If its answer is lost, `say` is called with a line about what this waits for.

    Raises as `Bus.call`, but not NoService for a planner that received the request: the outcome is then learned from
    the bus, or the result says that it is not known.
    """
    with ExitStack() as stack:
        asked = _Asked(bus, request, stack)
        try:
            return bus.call(ASSEMBLE, request, deadline_s)
        except NotSent:
            raise
        except (NoService, CommandRefused) as lost:
            if isinstance(lost, CommandRefused) and lost.code != STOPPING:
                raise
            say(f"{PLANNER} does not answer any more: waiting for its own word, or its successor's")
            return asked.learn(str(lost), say)


class _Asked:
    """The topics that tell the outcome, subscribed from before the request on."""

    def __init__(self, bus: Bus, request: Assemble, stack: ExitStack) -> None:
        self._bus, self._request = bus, request
        self._statuses: Latest[ServiceStatus] = stack.enter_context(bus.reading(STATUS, 64))
        self._events: Latest[Event] = stack.enter_context(bus.reading(EVENTS, 256))
        self._refusals: Latest[CommandRefusal] = stack.enter_context(bus.reading(REFUSAL, 64))
        self._touches = stack.enter_context(bus.reading(TOUCH, KEPT))
        self._answers: list[Latest[Message]] = []
        for command in HEARD:
            self._answers.append(stack.enter_context(bus.reading(command.reply_echo, KEPT)))
        self._began_ns = bus.clock.now_ns()
        self._asked_at = time.monotonic()
        self._before: list[Message] = []  # kept, so that a later message is not mistaken for one of these
        heard: tuple[Latest[Any], ...] = (self._events, self._refusals, *self._answers)
        for latest in heard:
            self._before += latest.values()

    def _new(self, latest: Latest[Any]) -> list[Any]:
        """The messages since the request that belong to this run of the cell."""
        before = {id(sample) for sample in self._before}
        return [one for one in latest.values() if id(one) not in before and one.stamp_ns >= self._began_ns]

    def learn(self, why: str, say: Callable[[str], object]) -> AssemblyResult:
        """Learn the outcome from the bus. Raises CommandRefused if the planner refused the request."""
        until = time.monotonic() + BACK_S
        last: tuple[int, float] = (-1, -1.0)
        ready_at: float | None = None
        while time.monotonic() < until:
            if (answer := self._answer()) is not None:
                return answer
            status = self._planner()
            if status is not None and (status.pid, status.uptime_s) != last:
                last = (status.pid, status.uptime_s)
                if self._is_successor(status):
                    return self._successor(why, say)
                if status.state is ServiceState.ACTIVE:
                    until, ready_at = time.monotonic() + BACK_S, None
                elif status.state is ServiceState.READY and ready_at is None:
                    ready_at = time.monotonic()
            if ready_at is not None and time.monotonic() > ready_at + LATE_S:
                return self._unknown(f"{why}; {PLANNER} has ended it, and its answer was lost on the way", False)
            time.sleep(_POLL_S)
        return self._unknown(
            f"{why}; {PLANNER} is not back after {BACK_S:g} s: the peg may be in the hole (`crosspih withdraw`)", False
        )

    def _answer(self) -> AssemblyResult | None:
        for result in self._new(self._answers[0]):
            if result.assembly_id == self._request.assembly_id:
                found: AssemblyResult = result
                return found
        for refusal in self._new(self._refusals):
            if refusal.command == ASSEMBLE.path and refusal.refused != STOPPING:
                raise CommandRefused(refusal.refused, refusal.text)
        return None

    def _planner(self) -> ServiceStatus | None:
        told = [status for status in self._statuses.values() if status.service == PLANNER]
        return told[-1] if told else None

    def _is_successor(self, status: ServiceStatus) -> bool:
        """Whether this planner was started after the request."""
        return status.uptime_s < time.monotonic() - self._asked_at - YOUNGER_S

    def _successor(self, why: str, say: Callable[[str], object]) -> AssemblyResult:
        why = f"{PLANNER} ended in the middle of the assembly ({why})"
        until = time.monotonic() + FOUND_S
        while not (found := [event for event in self._new(self._events) if self._tells(event)]):
            if time.monotonic() > until:
                return self._unknown(f"{why}; its successor is there, but told nothing of the peg", False)
            time.sleep(_POLL_S)
        told = found[-1]
        if told.code != "peg_found":
            return self._unknown(f"{why}; {told.text}", told.code == "arm_found")
        say("its successor takes the peg out")
        try:
            out = self._bus.call(WITHDRAW, Withdraw(), WITHDRAW_DEADLINE_S)
        except CrosspihError as error:
            return self._unknown(f"{why}; {told.text}; it could not be taken out: {error}", False)
        if out.failure is not None:
            stuck = f"{out.failure.value} {out.failure_detail}"
            return self._unknown(f"{why}; the peg could not be taken out: {stuck}", False)
        return self._unknown(f"{why}; its successor took the peg out, {out.distance_m * 1e3:.0f} mm", True)

    @staticmethod
    def _tells(event: Event) -> bool:
        # a planner that takes a peg out on its way home publishes this too, but without a warning
        return event.service == PLANNER and event.code in FOUND and event.severity is Severity.WARNING

    def _unknown(self, detail: str, backed_off: bool) -> AssemblyResult:
        """A result without the planner's own account, made from the outcomes of its motions."""
        motions = [one for latest in self._answers[1:] for one in self._new(latest) if isinstance(one, MotionOutcome)]
        own_peak_n = max((one.peak_force_n for one in motions), default=0.0)
        return AssemblyResult(
            assembly_id=self._request.assembly_id,
            strategy=self._request.strategy,
            inserted=False,
            failure=Failure.SERVICE_LOST,
            failure_detail=detail,
            backed_off=backed_off,
            pose_base_hole=None,
            pose_base_peg=max(motions, key=lambda one: one.stamp_ns).pose_base_peg if motions else None,
            vision_pose_base_hole=None,
            motion_s=sum(one.duration_s for one in motions),
            thinking_s=0.0,
            touches=len(self._new(self._touches)),
            presses=0,
            corrections=0,
            pushes=sum(1 for one in self._new(self._answers[-1]) if isinstance(one, MotionOutcome)),
            peak_force_n=own_peak_n,
            peak_moment_nm=max((one.peak_moment_nm for one in motions), default=0.0),
            insertion_depth_m=0.0,
        )
