"""Binds the assembly to its keys."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from crosspih_common.bus import Bus
from crosspih_common.bus.bus import NOW_LANE
from crosspih_common.errors import BusError, CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.holding import ArmLease, hold_arm, pulse_of
from crosspih_common.holding.soundness import TICKS_KEPT, require_not_doubled
from crosspih_common.keys import (
    ABORT,
    ASSEMBLE,
    CALIBRATE_FT,
    CLOCK,
    FT_CALIBRATION,
    LEASE,
    PAUSE,
    PHASE,
    STOP,
    TOUCH,
    WITHDRAW,
)
from crosspih_common.messages import (
    AbortAccepted,
    AbortAssembly,
    Assemble,
    AssemblyResult,
    CalibrateFt,
    Failure,
    FtCalibration,
    PauseAccepted,
    PauseAssembly,
    PoseData,
    StopMotion,
    Withdraw,
    WithdrawResult,
)
from crosspih_common.service import ServiceContext
from services.planning.asking import RETRY_S, BusPorts
from services.planning.assembly import assemble
from services.planning.calibrating import calibrate
from services.planning.config import PlanningConfig
from services.planning.leaving import home
from services.planning.missed import MissedServices
from services.planning.pausing import Pause
from services.planning.ports import AssemblyFailed
from services.planning.predecessor import HELD, HELD_S, Predecessor
from services.planning.result import result_of
from services.planning.run import Run
from services.planning.strategies.by_name import strategy_named
from services.planning.withdrawing import withdraw_peg


class PlanningShell:
    """The service on the bus."""

    def __init__(self, context: ServiceContext, config: PlanningConfig) -> None:
        self.context, self._config = context, config
        self.bus: Bus = context.bus
        self.abort = threading.Event()
        self.pause = Pause()
        self.closing = threading.Event()
        self._running = False
        self.has_held = False  # the arm, since it was started
        self._one_holder = threading.Lock()
        self.calibration = self.bus.latest(FT_CALIBRATION)
        self.clock = self.bus.latest(CLOCK, TICKS_KEPT)
        self.missed = MissedServices(context)
        pulse_of(self.bus)  # begins to start, so that the first assembly need not wait for it
        self._last_hole: Pose | None = None  # as the last assembly found or believed it
        self.phases = self.bus.publisher(PHASE)
        self.touches = self.bus.publisher(TOUCH)
        self.bus.serve(ASSEMBLE, self._assemble, refuse_when_busy=True)
        self.bus.serve(CALIBRATE_FT, self._calibrate, refuse_when_busy=True)
        self.bus.serve(WITHDRAW, self._withdraw, refuse_when_busy=True)
        self.bus.serve(ABORT, self._abort, lane=NOW_LANE)
        self.bus.serve(PAUSE, self._pause, lane=NOW_LANE)
        self.lease_state = self.bus.latest(LEASE)
        self._predecessor = Predecessor(self, config)

    @contextmanager
    def holding(self, purpose: str) -> Iterator[ArmLease]:
        """The arm held for a block, once the cell looks fit for it.

        Raises CommandRefused: held, cell_unfit; service_lost when no arm is there within the patience.
        """
        with self._one_holder, self._held(purpose) as lease:
            yield lease

    @contextmanager
    def _held(self, purpose: str) -> Iterator[ArmLease]:
        require_not_doubled(self.bus.cell, self.clock.values())
        lease = hold_arm(self.bus, purpose)
        give_up_at = time.monotonic() + self._config.service_patience_s
        let_go_by = time.monotonic() + HELD_S
        while True:
            try:
                lease.take()
                self.has_held = True
                break
            except CommandRefused as refusal:
                # the arm lets go of a planner that is gone by itself, but not at once
                if refusal.code != HELD or not self._held_by_predecessor() or self.abort.is_set():
                    raise
                if time.monotonic() > let_go_by:
                    raise
                self.closing.wait(RETRY_S)
            except BusError as error:
                if self.abort.is_set() or time.monotonic() > give_up_at:
                    raise CommandRefused(
                        Failure.SERVICE_LOST.value, f"hardware: the arm cannot be held: {error}"
                    ) from None
                self.closing.wait(RETRY_S)
        self.pause.ask(False)
        self._running = True
        try:
            with self.missed.reported():
                yield lease
        finally:
            self._running = False
            lease.give()

    def _held_by_predecessor(self) -> bool:
        """Whether the arm's holder is the planner before this one: asked where this one does not hold it."""
        state = self.lease_state.value()
        return not self.has_held and state is not None and state.holder == self.bus.service

    def _assemble(self, request: Assemble) -> AssemblyResult:
        self.abort.clear()
        strategy_named(request.strategy, self._config)  # before the arm is taken
        with self.holding(f"assembly {request.assembly_id}".strip()) as lease:
            ports = BusPorts(self, self._config, lease)
            started = time.monotonic()
            done = assemble(self.context.cell.workcell, self._config, ports, request)
        self._last_hole = done.run.hole.believed
        if done.final is not None:
            self._last_hole = done.final.pose_base_hole.pose()
        thinking_s = max(time.monotonic() - started - ports.hardware_wall_s - ports.paused_wall_s, 0.0)
        return result_of(request, done, thinking_s)

    def _calibrate(self, request: CalibrateFt) -> FtCalibration:
        self.abort.clear()
        with self.holding("calibration of the force/torque sensor") as lease:
            run = Run(self.context.cell.workcell, self._config, BusPorts(self, self._config, lease), "")
            try:
                run.ports.look(lambda: run.motion.dwell(0.05))
                home(run)
                return calibrate(run, request.samples_s, request.temperature_c)
            except AssemblyFailed as error:
                raise CommandRefused(error.failure.value, error.detail) from None

    def _withdraw(self, request: Withdraw) -> WithdrawResult:
        self.abort.clear()
        workcell = self.context.cell.workcell
        hole = self._last_hole or workcell.hole_prior.pose_base_hole()
        if request.pose_base_hole is not None:
            hole = request.pose_base_hole.pose()
        with self.holding("withdrawal") as lease:
            run = Run(workcell, self._config, BusPorts(self, self._config, lease), "withdraw")
            done = withdraw_peg(run, request, hole)
        return WithdrawResult(
            withdrawn=done.failure is None,
            failure=done.failure,
            failure_detail=done.detail,
            distance_m=done.distance_m,
            pose_base_peg=PoseData.of(run.motion.pose_base_peg),
            motion_s=run.counts.motion_s,
            peak_force_n=run.counts.peak_force_n,
            peak_moment_nm=run.counts.peak_moment_nm,
        )

    def _abort(self, request: AbortAssembly) -> AbortAccepted:
        was_running = self._running
        self.abort.set()
        if was_running:
            try:
                self.bus.call(STOP, StopMotion(), 2.0)
            except BusError as error:
                raise CommandRefused("stop", f"the arm could not be told to stop: {error}") from None
        return AbortAccepted(was_running=was_running)

    def _pause(self, request: PauseAssembly) -> PauseAccepted:
        if not self._running:
            return PauseAccepted(was_running=False, paused=False)
        self.pause.ask(request.paused)
        return PauseAccepted(was_running=True, paused=request.paused)

    def close(self) -> None:
        """End a running assembly."""
        self.abort.set()
        self.closing.set()
