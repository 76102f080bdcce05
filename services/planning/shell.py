"""Binds the assembly to its keys."""

from __future__ import annotations

import dataclasses
import threading
import time
from typing import TypeVar

from crosspih_common.bus import Bus
from crosspih_common.bus.bus import NOW_LANE
from crosspih_common.errors import BusError, CommandRefused, CommandTimeout
from crosspih_common.keys import (
    ABORT,
    ASSEMBLE,
    CALIBRATE_FT,
    CLOCK,
    FT_CALIBRATION,
    PHASE,
    STOP,
    TOUCH,
    Command,
)
from crosspih_common.messages import (
    AbortAccepted,
    AbortAssembly,
    Assemble,
    AssemblyPhase,
    AssemblyResult,
    CalibrateFt,
    Failure,
    FtCalibration,
    HoleEstimate,
    Message,
    PoseData,
    StopMotion,
    Touch,
)
from crosspih_common.service import ServiceContext
from services.planning.assembly import assemble
from services.planning.calibrating import calibrate
from services.planning.config import PlanningConfig
from services.planning.leaving import home
from services.planning.ports import AssemblyFailed
from services.planning.run import Run

RequestT = TypeVar("RequestT", bound=Message)
ReplyT = TypeVar("ReplyT", bound=Message)
RETRY_S = 0.2


class BusPorts:
    """The ports over the bus. Counts the wall time in which the hardware was at work, so that thinking is the rest."""

    def __init__(self, shell: PlanningShell, config: PlanningConfig) -> None:
        self._shell, self._config, self._bus = shell, config, shell.bus
        self._heed_abort = True
        self._boot_id: str | None = None
        self.hardware_wall_s = 0.0

    def ask(self, command: Command[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """Ask; again while the service is away, up to the patience.

        A motion that may have begun is never asked for twice, and none at all of a cell that was started again since
        the first: its arm stands elsewhere and knows no payload. Only backing off deals with such a cell.
        """
        moves = command.server == "hardware"
        deadline_s = self._config.motion_deadline_s if moves else self._config.answer_deadline_s
        give_up_at = time.monotonic() + self._config.service_patience_s
        timeouts = 0
        while True:
            if self._heed_abort and self._shell.abort.is_set():
                raise AssemblyFailed(Failure.ABORTED, "somebody ended the assembly")
            if moves:
                self._require_same_cell()
            started = time.monotonic()
            try:
                reply = self._bus.call(command, request, deadline_s)
            except BusError as error:
                timeouts += isinstance(error, CommandTimeout)
                begun = self._boot_id is not None and self._heed_abort
                sent_for_good = moves and (begun or time.monotonic() - started > RETRY_S)
                if sent_for_good or timeouts > 1 or time.monotonic() > give_up_at:
                    raise AssemblyFailed(Failure.SERVICE_LOST, f"{command.server}: {error}") from None
                self._shell.closing.wait(RETRY_S)
                continue
            elapsed = time.monotonic() - started
            if moves:
                self._remember_cell()
                self.hardware_wall_s += elapsed
            elif isinstance(reply, HoleEstimate):
                self.hardware_wall_s += reply.capture_wall_s
            return reply

    def _remember_cell(self) -> None:
        tick = self._shell.clock.value()
        if self._boot_id is None and tick is not None:
            self._boot_id = tick.boot_id
        self._require_same_cell()

    def _require_same_cell(self) -> None:
        tick = self._shell.clock.value()
        if self._heed_abort and self._boot_id is not None and tick is not None and tick.boot_id != self._boot_id:
            raise AssemblyFailed(Failure.SERVICE_LOST, "hardware: it was started again during the assembly")

    def ft_calibration(self) -> FtCalibration | None:
        """As last published; waits a little for a service that has just started."""
        return self._shell.calibration.wait_for(lambda _: True, self._config.service_patience_s)

    def tell_phase(self, phase: AssemblyPhase) -> None:
        """Publish a step."""
        self._shell.phases.publish(phase)

    def tell_touch(self, touch: Touch) -> None:
        """Publish a touch."""
        self._shell.touches.publish(touch)

    def ignore_abort(self) -> None:
        """From here on finish what was begun."""
        self._heed_abort = False


class PlanningShell:
    """The service on the bus."""

    def __init__(self, context: ServiceContext, config: PlanningConfig) -> None:
        self._context, self._config = context, config
        self.bus: Bus = context.bus
        self.abort = threading.Event()
        self.closing = threading.Event()
        self._running = False
        self.calibration = self.bus.latest(FT_CALIBRATION)
        self.clock = self.bus.latest(CLOCK)
        self.phases = self.bus.publisher(PHASE)
        self.touches = self.bus.publisher(TOUCH)
        self.bus.serve(ASSEMBLE, self._assemble, refuse_when_busy=True)
        self.bus.serve(CALIBRATE_FT, self._calibrate, refuse_when_busy=True)
        self.bus.serve(ABORT, self._abort, lane=NOW_LANE)

    def _assemble(self, request: Assemble) -> AssemblyResult:
        self.abort.clear()
        self._running = True
        ports = BusPorts(self, self._config)
        started = time.monotonic()
        try:
            done = assemble(self._context.cell.workcell, self._config, ports, request)
        finally:
            self._running = False
        run = done.run
        believed = done.final.pose_base_hole if done.final is not None else None
        if believed is None and run.believed is not None:
            believed = PoseData.of(run.believed)
        return AssemblyResult(
            assembly_id=request.assembly_id,
            strategy=request.strategy,
            inserted=done.final is not None,
            failure=done.failure,
            failure_detail=done.detail,
            backed_off=done.backed_off,
            pose_base_hole=believed,
            covariance=None if done.final is None else done.final.covariance,
            rank=None if done.final is None else done.final.rank,
            pose_base_peg=PoseData.of(run.pose_base_peg),
            vision_refused=run.vision_refused,
            vision_pose_base_hole=None if run.vision_pose is None else PoseData.of(run.vision_pose),
            motion_s=run.motion_s,
            thinking_s=max(time.monotonic() - started - ports.hardware_wall_s, 0.0),
            touches=len(run.touches),
            presses=len(run.presses),
            corrections=run.corrections,
            pushes=run.pushes,
            peak_force_n=run.peak_force_n,
            peak_moment_nm=run.peak_moment_nm,
            insertion_depth_m=done.insertion_depth_m,
            **dataclasses.asdict(run.effort),
        )

    def _calibrate(self, request: CalibrateFt) -> FtCalibration:
        self.abort.clear()
        self._running = True
        try:
            run = Run(self._context.cell.workcell, self._config, BusPorts(self, self._config), "")
            run.dwell(0.05)
            home(run)
            return calibrate(run, request.samples_s)
        except AssemblyFailed as error:
            raise CommandRefused(error.failure.value, error.detail) from None
        finally:
            self._running = False

    def _abort(self, request: AbortAssembly) -> AbortAccepted:
        was_running = self._running
        self.abort.set()
        if was_running:
            try:
                self.bus.call(STOP, StopMotion(), 2.0)
            except BusError as error:
                raise CommandRefused("stop", f"the arm could not be told to stop: {error}") from None
        return AbortAccepted(was_running=was_running)

    def close(self) -> None:
        """End a running assembly."""
        self.abort.set()
        self.closing.set()
