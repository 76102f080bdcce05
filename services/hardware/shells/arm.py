"""Binds the arm with its wrist sensor to their keys, the cell's clock among them."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
import uuid
from collections.abc import Callable
from typing import TypeVar

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.bus.bus import NOW_LANE
from crosspih_common.errors import BusError
from crosspih_common.keys import (
    ADMITTANCE_MOVE,
    CLOCK,
    DWELL,
    FOLLOW,
    GUARDED_MOVE,
    JOINT_STATE,
    LEASE,
    LEASE_BEAT,
    LEASE_GIVE,
    LEASE_TAKE,
    MOVE_LINEAR,
    SET_PAYLOAD,
    STOP,
    WALL_CLOCK,
    WRENCH_RAW,
    Command,
)
from crosspih_common.messages import (
    AskWallClock,
    CellClock,
    GiveLease,
    LeaseBeat,
    LeaseGiven,
    LeaseGranted,
    Message,
    PayloadAccepted,
    SetPayload,
    StopAccepted,
    StopMotion,
    TakeLease,
    WallClock,
)
from services.hardware.control.arm import ArmController

RequestT = TypeVar("RequestT", bound=Message)
ReplyT = TypeVar("ReplyT", bound=Message)

MOTION_S = 900.0  # of wall time: as long as the planner waits for one (planning.motion_deadline_s)
ARM_LANE = "arm"  # one motion at a time: a second one is refused, never queued


class ArmShell:
    """Streams what arm and sensor say, serves what the controller can do to whoever holds the arm."""

    def __init__(self, arm: ArmController, bus: Bus, realtime: bool, simulated: bool) -> None:
        self._arm, self._bus = arm, bus
        self._boot_id = uuid.uuid4().hex[:8]
        self._realtime, self._simulated = realtime, simulated
        self._clock = bus.publisher(CLOCK)
        self._on_tick: list[Callable[[], object]] = []
        joints, wrench, lease = bus.publisher(JOINT_STATE), bus.publisher(WRENCH_RAW), bus.publisher(LEASE)
        arm.on_joint_state(joints.publish)
        arm.on_batch(wrench.publish)
        arm.on_tick(self.tick)
        self.tick(arm.now_ns())
        joints.publish(arm.joint_state())
        lease.publish(arm.holder.state())
        arm.holder.on_change = lease.publish
        bus.subscribe_inline(LEASE_BEAT, self._beat)
        self._closing = threading.Event()
        self._beating: threading.Thread | None = None
        if realtime:
            self._beating = threading.Thread(target=self._beat_beside, name="own-beats", daemon=True)
            self._beating.start()
        bus.serve(LEASE_TAKE, self._take, lane=NOW_LANE)
        bus.serve(LEASE_GIVE, self._give, lane=NOW_LANE)
        self._serve(FOLLOW, arm.follow)
        self._serve(MOVE_LINEAR, arm.move_linear)
        self._serve(GUARDED_MOVE, arm.guarded_move)
        self._serve(ADMITTANCE_MOVE, arm.admittance_move)
        self._serve(DWELL, arm.dwell)
        bus.serve(SET_PAYLOAD, self._set_payload, lane=ARM_LANE)
        bus.serve(STOP, self._stop, lane=NOW_LANE)
        bus.serve(WALL_CLOCK, self._wall_clock, lane=NOW_LANE)

    def also_on_tick(self, listener: Callable[[], object]) -> None:
        """Call after each tick of the clock, on the arm's loop."""
        self._on_tick.append(listener)

    def tick(self, now_ns: int) -> None:
        """Tell the cell's time."""
        self._bus.clock.observe(now_ns, self._boot_id)
        self._clock.publish(
            CellClock(stamp_ns=now_ns, boot_id=self._boot_id, realtime=self._realtime, simulated=self._simulated)
        )
        for listener in self._on_tick:
            listener()

    def _serve(self, command: Command[RequestT, ReplyT], move: Callable[[RequestT], ReplyT]) -> None:
        """A motion, for the holder alone; a stop ends it from the instant in which it was accepted.

        It ends with a tick: what is true at the instant of its outcome can be heard, not only guessed.
        """

        def moved(request: RequestT) -> ReplyT:
            self._arm.holder.require(request.lease)  # type: ignore[attr-defined]
            outcome = move(request)
            self.tick(self._arm.now_ns())
            return outcome

        self._bus.serve(
            command, moved, lane=ARM_LANE, refuse_when_busy=True, on_accept=self._arm.accept, on_end=self._arm.done,
            longest_s=MOTION_S,
        )  # fmt: skip

    @staticmethod
    def _wall_clock(request: AskWallClock) -> WallClock:
        """For others to compare theirs with: nothing here is done by it."""
        return WallClock(host=socket.gethostname(), wall_ns=time.time_ns())

    def _beat(self, beat: LeaseBeat) -> None:
        if beat.holder == self._bus.service and not beat.lease:
            self._arm.holder.own_beat()
        else:
            self._arm.holder.beat(beat.lease)

    def _beat_beside(self) -> None:
        """The arm's own beats, heard as its holder's are: so that a busy machine can be told from a silent holder.

        They go through the router and back, over a session of their own: what a session publishes it hears at once.
        """
        own = LeaseBeat(lease="", holder=self._bus.service)
        with contextlib.ExitStack() as stack, contextlib.suppress(BusError):
            bus = self._bus
            if bus.endpoint is not None:
                bus = stack.enter_context(Bus(open_zenoh(bus.endpoint, service=bus.service), bus.cell, bus.service))
            beats = bus.publisher(LEASE_BEAT)
            while not self._closing.wait(self._arm.holder.beat_s):
                if self._arm.holder.state().holder:
                    with contextlib.suppress(BusError):
                        beats.publish(own)

    def close(self) -> None:
        """Beat no more."""
        self._closing.set()
        if self._beating is not None:
            self._beating.join()

    def _take(self, request: TakeLease) -> LeaseGranted:
        holder = self._arm.holder
        lease = holder.take(request.holder, request.purpose, self._arm.now_ns())
        return LeaseGranted(lease=lease, holder=request.holder, timeout_s=holder.timeout_s, beat_s=holder.beat_s)

    def _give(self, request: GiveLease) -> LeaseGiven:
        was_held = self._arm.holder.give(request.lease, self._arm.now_ns())
        if was_held:
            self._arm.stop()
        return LeaseGiven(was_held=was_held)

    def _set_payload(self, command: SetPayload) -> PayloadAccepted:
        self._arm.holder.require(command.lease)
        self._arm.set_payload(command)
        return PayloadAccepted(weight_n=command.weight_n)

    def _stop(self, command: StopMotion) -> StopAccepted:
        return StopAccepted(was_moving=self._arm.stop())
