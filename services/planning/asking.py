"""The assembly's ports over the bus: sends requests, holds the arm, detects lost services."""

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
    """The ports over the bus. They count the wall time in which the hardware was working or paused; the rest is the
    thinking time.
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
        """Send a request, and repeat it while the service is away, up to the patience.

        A motion that may have begun is never requested twice. No motion is requested from a cell that was restarted
        since the first one: its arm is elsewhere and knows no payload. Only backing off works with such a cell, and
        with an arm that has released its holder: it takes the lease anew.
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
                    # the arm itself ends the motion during which the link was lost
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
        """Send once. A service that was stopped counts as lost, like a killed one: the launcher may start it again."""
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
        """How long to wait for a lost service, s; longer while the peg is taken out: nothing else would do it."""
        return self._config.service_patience_s * (1.0 if self._heed_abort else BACKING_OFF_PATIENCE)

    def _take_anew(self) -> None:
        """Take the lease again. If the router is away as well, wait for it as for any service."""
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
