"""Records everything by which a case is judged: joints, true contact, steps, events, tokens, the lease,
the outcomes.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from crosspih_common.geometry.pose import Array
from crosspih_common.keys import (
    ADMITTANCE_MOVE,
    EVENTS,
    FOLLOW,
    GUARDED_MOVE,
    JOINT_STATE,
    LEASE,
    LEASE_BEAT,
    MOVE_LINEAR,
    PHASE,
    TRUTH,
    Command,
)
from crosspih_common.messages import (
    AssemblyPhase,
    Event,
    JointState,
    LeaseBeat,
    LeaseState,
    MotionOutcome,
    Phase,
    SimulationTruth,
    StopReason,
)
from services.operator.assembly.session import Session

MOTIONS: tuple[Command[Any, Any], ...] = (FOLLOW, MOVE_LINEAR, GUARDED_MOVE, ADMITTANCE_MOVE)


class Watch:
    """Records from its creation to the session's end."""

    def __init__(self, session: Session) -> None:
        self._changed = threading.Condition()
        self._service = ""
        self._joints: list[JointState] = []
        self._truths: list[SimulationTruth] = []
        self.phases: list[AssemblyPhase] = []
        self.speed_rad_s = self.force_n = 0.0
        self._at_s = float("inf")
        self._signal_ns, self._phases_before, self._truths_before = 0, 0, 0
        self._gone_ns = 0
        self._named: tuple[float, str] | None = None
        self.let_go_ns: int | None = None
        self.outcome: MotionOutcome | None = None
        bus = session.bus
        bus.subscribe_inline(JOINT_STATE, self._on_joints)
        bus.subscribe_inline(TRUTH, self._on_truth)
        bus.subscribe_inline(PHASE, self._on_phase)
        bus.subscribe_inline(EVENTS, self._on_event)
        bus.subscribe_inline(LEASE, self._on_lease)
        bus.subscribe_inline(LEASE_BEAT, self._on_beat)
        bus.watch_alive(self._on_alive)
        for command in MOTIONS:
            bus.subscribe_inline(command.reply_echo, self._on_outcome)

    # -------------------------------------------------------------------------------------------------------- hearing

    def _on_joints(self, state: JointState) -> None:
        with self._changed:
            self._joints.append(state)
            self.speed_rad_s = float(np.abs(state.speeds_rad_s).max())
            self._changed.notify_all()

    def _on_truth(self, truth: SimulationTruth) -> None:
        with self._changed:
            self._truths.append(truth)
            self.force_n = float(np.linalg.norm(truth.wrench_contact[:3]))
            self._changed.notify_all()

    def _on_phase(self, phase: AssemblyPhase) -> None:
        with self._changed:
            self.phases.append(phase)
            self._changed.notify_all()

    def _on_event(self, event: Event) -> None:
        if event.code == "service_lost" and event.text.startswith(f"{self._service} "):
            self._name(f"event of {event.service}")

    def _on_alive(self, service: str, alive: bool) -> None:
        if not alive and service == self._service:
            self._name("its token")

    def _on_lease(self, state: LeaseState) -> None:
        if not state.holder:
            with self._changed:
                if self._at_s < float("inf") and self.let_go_ns is None:
                    self.let_go_ns = state.since_ns
                    self._changed.notify_all()
            if self._service == "planning":
                self._name("the arm, which let go")

    def _on_beat(self, beat: LeaseBeat) -> None:
        with self._changed:
            if beat.holder == self._service and self._joints:
                self._gone_ns = self._joints[-1].stamp_ns

    def _on_outcome(self, outcome: MotionOutcome) -> None:
        ended_ns = outcome.start_stamp_ns + round(outcome.duration_s * 1e9)
        with self._changed:
            if self.outcome is None and self._at_s < float("inf") and ended_ns >= self._signal_ns:
                self.outcome = outcome
                self._changed.notify_all()

    def _name(self, by: str) -> None:
        now = time.monotonic()
        with self._changed:
            if self._named is None and now >= self._at_s:
                self._named = (now - self._at_s, by)
                self._changed.notify_all()

    # --------------------------------------------------------------------------------------------------------- asking

    def wait(self, condition: Callable[[], bool], deadline_s: float) -> bool:
        """Wait until a condition holds, or the deadline; returns whether it holds. Checked again with each message."""
        with self._changed:
            return self._changed.wait_for(condition, deadline_s)

    def signalled(self, service: str) -> None:
        """The signal is about to be sent: times count from here, the cell's from the newest stamp received."""
        with self._changed:
            self._service, self._at_s = service, time.monotonic()
            self._signal_ns = max((state.stamp_ns for state in self._joints[-1:]), default=0)
            self._gone_ns = self._signal_ns
            self._phases_before, self._truths_before = len(self.phases), len(self._truths)

    def reported_by_asker(self) -> None:
        """Whether the client that requested the assembly was told that the service is gone."""
        self._name("the answer")

    def since(self) -> list[AssemblyPhase]:
        """The steps published since the signal."""
        with self._changed:
            return self.phases[self._phases_before :]

    @property
    def named(self) -> tuple[float, str] | None:
        """The wall time until the loss was named, s, and by whom."""
        return self._named

    @property
    def signal_ns(self) -> int:
        """The cell's time of the signal."""
        return self._signal_ns

    @property
    def gone_ns(self) -> int:
        """The cell's time at the last beat of the holder: a killed process takes a while to be gone."""
        return self._gone_ns

    def since_signal_s(self) -> float:
        """Wall time."""
        return time.monotonic() - self._at_s

    def joints_until(self, until_ns: int | None) -> tuple[Array, Array]:
        """Stamps (k,), ns, and joints (k, n), rad, up to a time of the cell."""
        with self._changed:
            kept = [state for state in self._joints if until_ns is None or state.stamp_ns <= until_ns]
        return np.array([state.stamp_ns for state in kept]), np.array([state.joints_rad for state in kept])

    def peak_n(self) -> float:
        """The largest true force since the signal: of each tick, and of every step that set a new maximum."""
        with self._changed:
            before, after = self._truths[: self._truths_before], self._truths[self._truths_before :]
        peak = max((float(np.linalg.norm(truth.wrench_contact[:3])) for truth in after), default=0.0)
        known = max((truth.peak_contact_n or 0.0 for truth in before), default=0.0)
        grown = max((truth.peak_contact_n or 0.0 for truth in after), default=0.0)
        return max(peak, grown) if grown > known else peak

    def last_truth(self) -> SimulationTruth | None:
        """The latest truth."""
        with self._changed:
            return self._truths[-1] if self._truths else None

    def done_reported(self) -> bool:
        """Whether the assembly reported its end after the signal."""
        with self._changed:
            return any(phase.phase is Phase.DONE for phase in self.phases[self._phases_before :])

    def stop_reason(self) -> str:
        """How the motion under way at the signal ended; empty when none was."""
        outcome = self.outcome
        if outcome is None or outcome.start_stamp_ns > self._signal_ns:
            return ""
        return outcome.stop_reason.value

    def broken_off_ns(self) -> int | None:
        """When the motion that lost its holder had ended, including its way back, cell time."""
        outcome = self.outcome
        if outcome is None or outcome.stop_reason is not StopReason.HOLDER_LOST:
            return None
        return outcome.start_stamp_ns + round(outcome.duration_s * 1e9)
