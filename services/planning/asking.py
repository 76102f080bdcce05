"""The assembly's ports over the bus: asks services, holds the arm, notices who is lost."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from typing import TypeVar

from crosspih_common.errors import STOPPING, BusError, CommandRefused, CommandTimeout, NoService, NotSent
from crosspih_common.holding import ArmLease
from crosspih_common.holding.soundness import LiveStreams
from crosspih_common.keys import Command
from crosspih_common.messages import (
    AssemblyPhase,
    Failure,
    FtCalibration,
    HoleEstimate,
    Message,
    MotionOutcome,
    Severity,
    Touch,
)
from services.planning.config import PlanningConfig
from services.planning.host import AssemblyHost
from services.planning.ports import AssemblyFailed

RequestT = TypeVar("RequestT", bound=Message)
ReplyT = TypeVar("ReplyT", bound=Message)
RETRY_S = 0.2
NO_LEASE = "no_lease"
BUSY = "busy"
BACKING_OFF_PATIENCE = 3.0  # times the patience


class BusPorts:
    """The ports over the bus. Counts the wall time in which the hardware was at work, and in which somebody had it
    paused, so that thinking is the rest.
    """

    def __init__(self, host: AssemblyHost, config: PlanningConfig, lease: ArmLease) -> None:
        self._host, self._config, self._bus, self._lease = host, config, host.bus, lease
        self._heed_abort = True
        self._boot_id: str | None = None
        self.hardware_wall_s = self.paused_wall_s = 0.0

    def look(self, dwell: Callable[[], MotionOutcome]) -> MotionOutcome:
        """See Ports."""
        with LiveStreams(self._bus) as streams:
            return streams.require_fresh(dwell)

    def ask(self, command: Command[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """Ask; again while the service is away, up to the patience.

        A motion that may have begun is never asked for twice, and none at all of a cell that was started again since
        the first: its arm stands elsewhere and knows no payload. Only backing off deals with such a cell, and with an
        arm that has let go of its holder: it takes it anew.
        """
        moves = command.server == "hardware"
        deadline_s = self._config.motion_deadline_s if moves else self._config.answer_deadline_s
        give_up_at: float | None = None
        retaken = False
        first_busy_at: float | None = None
        while True:
            if self._heed_abort and self._host.abort.is_set():
                raise AssemblyFailed(Failure.ABORTED, "somebody ended the assembly")
            if moves and self._heed_abort:
                self.paused_wall_s += self._host.pause.wait_to_go_on(self._host.abort.is_set, self.publish_event)
                if self._host.abort.is_set():
                    continue
            if moves:
                self._require_same_cell()
            started = time.monotonic()
            try:
                reply = self._ask_once(command, request, deadline_s)
            except BusError as error:
                now = time.monotonic()
                if give_up_at is None:
                    give_up_at = now + self._patience_s
                    self._tell_lost(command, error)
                begun = self._boot_id is not None and self._heed_abort
                never_sent = isinstance(error, NotSent) or now - started <= RETRY_S
                sent_for_good = moves and (begun or not never_sent)
                if sent_for_good or isinstance(error, CommandTimeout) or now > give_up_at:
                    raise AssemblyFailed(Failure.SERVICE_LOST, f"{command.server}: {error}", command.server) from None
                self._host.closing.wait(RETRY_S)
                continue
            except CommandRefused as refusal:
                if refusal.code == BUSY and moves and not self._heed_abort and self._waits_for_rest(first_busy_at):
                    # the motion that the link was lost in is being ended by the arm itself
                    first_busy_at = first_busy_at or time.monotonic()
                    self._host.closing.wait(RETRY_S)
                    continue
                if refusal.code != NO_LEASE:
                    raise
                if self._heed_abort or retaken:
                    raise AssemblyFailed(Failure.ARM_STOPPED, str(refusal)) from None
                self._take_anew()
                retaken = True
                continue
            elapsed = time.monotonic() - started
            if moves:
                self._remember_cell()
                self.hardware_wall_s += elapsed
            elif isinstance(reply, HoleEstimate):
                self.hardware_wall_s += reply.capture_wall_s
            return reply

    def _ask_once(self, command: Command[RequestT, ReplyT], request: RequestT, deadline_s: float) -> ReplyT:
        """A service that is stopped in order is as lost as one that is killed: whoever started it may bring it back."""
        try:
            return self._lease.ask(command, request, deadline_s)
        except CommandRefused as refusal:
            if refusal.code == STOPPING:
                raise NoService(str(refusal)) from None
            raise

    def _waits_for_rest(self, first_busy_at: float | None) -> bool:
        return first_busy_at is None or time.monotonic() - first_busy_at < self._patience_s

    @property
    def _patience_s(self) -> float:
        """With a lost service; longer where the peg is being taken out: nobody does that after this one gave up."""
        return self._config.service_patience_s * (1.0 if self._heed_abort else BACKING_OFF_PATIENCE)

    def _take_anew(self) -> None:
        """Also where the router is away that the arm was lost with: it is waited for as any service is."""
        give_up_at = time.monotonic() + self._patience_s
        while True:
            try:
                self._lease.take()
                return
            except (BusError, CommandRefused) as error:
                if isinstance(error, CommandRefused) or time.monotonic() > give_up_at:
                    raise AssemblyFailed(Failure.ARM_STOPPED, f"the arm cannot be held again: {error}") from None
            self._host.closing.wait(RETRY_S)

    def _tell_lost(self, command: Command[RequestT, ReplyT], error: BusError) -> None:
        self._host.missed.name(command.server, f"while it was asked ({command.path}): {error}")

    def _remember_cell(self) -> None:
        tick = self._host.clock.value()
        if self._boot_id is None and tick is not None:
            self._boot_id = tick.boot_id
        self._require_same_cell()

    def _require_same_cell(self) -> None:
        tick = self._host.clock.value()
        if self._heed_abort and self._boot_id is not None and tick is not None and tick.boot_id != self._boot_id:
            raise AssemblyFailed(Failure.SERVICE_LOST, "hardware: it was started again during the assembly", "hardware")

    def ft_calibration(self) -> FtCalibration | None:
        """As last published; waits a little for a service that has just started."""
        return self._host.calibration.wait_for(lambda _: True, self._config.service_patience_s)

    def publish_phase(self, phase: AssemblyPhase) -> None:
        """Publish a step."""
        self._host.phases.publish(phase)

    def publish_touch(self, touch: Touch) -> None:
        """Publish a touch."""
        self._host.touches.publish(touch)

    def publish_event(self, code: str, text: str) -> None:
        """See Ports."""
        self._host.context.event(Severity.INFO, code, text)

    def report_defect(self, error: Exception) -> None:
        """See Ports."""
        traceback.print_exception(error)
        self._host.context.event(Severity.ERROR, "defect", f"{type(error).__name__}: {error}")

    def ignore_abort(self) -> None:
        """From here on finish what was begun."""
        self._heed_abort = False
