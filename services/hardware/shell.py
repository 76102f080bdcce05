"""Binds a cell's devices to their keys; knows the Protocols only, never a driver."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from typing import TypeVar

from crosspih_common.bus.bus import NOW_LANE
from crosspih_common.keys import (
    ADMITTANCE_MOVE,
    CAMERA_CALIBRATION,
    CAPTURE,
    CLOCK,
    DWELL,
    FOLLOW,
    GUARDED_MOVE,
    IMAGE_LEFT,
    IMAGE_RIGHT,
    JOINT_STATE,
    LEASE,
    LEASE_BEAT,
    LEASE_GIVE,
    LEASE_TAKE,
    MOVE_LINEAR,
    RESET,
    SET_PAYLOAD,
    STOP,
    TRUTH,
    WRENCH_RAW,
)
from crosspih_common.messages import (
    CaptureStereo,
    CellClock,
    Frame,
    Image,
    Message,
    MotionOutcome,
    PayloadAccepted,
    ResetCell,
    SetPayload,
    SimulationTruth,
    StereoPair,
    StopAccepted,
    StopMotion,
    StopReason,
)
from crosspih_common.messages.motion import Held
from crosspih_common.service import ServiceContext
from services.hardware.lease_desk import LeaseDesk
from services.hardware.protocols import Cell, Simulation

RequestT = TypeVar("RequestT", bound=Message)
ReplyT = TypeVar("ReplyT", bound=Message)

LEASE_TIMEOUT_S = 0.1
ARM_LANE = "arm"  # one motion at a time: a second one is refused, never queued


class HardwareShell:
    """The cell on the bus: streams what the devices say, serves what they can do."""

    def __init__(self, cell: Cell, context: ServiceContext, realtime: bool) -> None:
        self._cell, self._bus = cell, context.bus
        self._boot_id = uuid.uuid4().hex[:8]
        self._realtime = realtime
        self._captures = 0
        bus, arm = self._bus, cell.arm
        self._clock = bus.publisher(CLOCK)
        self._images = bus.publisher(IMAGE_LEFT), bus.publisher(IMAGE_RIGHT)
        self._calibration = bus.publisher(CAMERA_CALIBRATION)
        self._truth = bus.publisher(TRUTH) if cell.simulation is not None else None
        joints, wrench = bus.publisher(JOINT_STATE), bus.publisher(WRENCH_RAW)

        arm.on_joint_state(joints.publish)
        cell.force_torque.on_batch(wrench.publish)
        cell.clock.on_tick(self._tick)
        self._tick(cell.clock.now_ns())
        holders = bus.publisher(LEASE)
        self._lost_holder = ""
        self._desk = LeaseDesk(LEASE_TIMEOUT_S, cell.clock.now_ns, holders.publish, self._holder_lost)
        bus.serve(LEASE_TAKE, self._desk.take, lane=NOW_LANE)
        bus.serve(LEASE_GIVE, self._desk.give, lane=NOW_LANE)
        bus.subscribe(LEASE_BEAT, self._desk.beat)
        self._calibration.publish(cell.camera.calibration())
        bus.serve(FOLLOW, self._ticked(arm.follow), lane=ARM_LANE, refuse_when_busy=True)
        bus.serve(MOVE_LINEAR, self._ticked(arm.move_linear), lane=ARM_LANE, refuse_when_busy=True)
        bus.serve(GUARDED_MOVE, self._ticked(arm.guarded_move), lane=ARM_LANE, refuse_when_busy=True)
        bus.serve(ADMITTANCE_MOVE, self._ticked(arm.admittance_move), lane=ARM_LANE, refuse_when_busy=True)
        bus.serve(DWELL, self._ticked(arm.dwell), lane=ARM_LANE, refuse_when_busy=True)
        bus.serve(CAPTURE, self._capture, lane=ARM_LANE)
        bus.serve(SET_PAYLOAD, self._set_payload, lane=ARM_LANE)
        bus.serve(STOP, self._stop, lane=NOW_LANE)
        if cell.simulation is not None:
            simulation = cell.simulation
            bus.serve(RESET, lambda command: self._reset(simulation, command), lane=ARM_LANE)

    def _tick(self, now_ns: int) -> None:
        self._bus.clock.observe(now_ns, self._boot_id)
        self._clock.publish(
            CellClock(
                stamp_ns=now_ns,
                boot_id=self._boot_id,
                realtime=self._realtime,
                simulated=self._cell.simulation is not None,
            )
        )
        if self._truth is not None and self._cell.simulation is not None:
            self._truth.publish(self._cell.simulation.truth())

    def _ticked(self, move: Callable[[RequestT], ReplyT]) -> Callable[[RequestT], ReplyT]:
        """A motion that ends with a tick: what is true at the instant of its outcome can be heard, not only guessed."""

        def moved(command: RequestT) -> ReplyT:
            if isinstance(command, Held):
                self._desk.require(command.lease)
            self._lost_holder = ""
            outcome = move(command)
            self._tick(self._cell.clock.now_ns())
            if self._lost_holder and isinstance(outcome, MotionOutcome) and outcome.stop_reason is StopReason.STOPPED:
                told = {"stop_reason": StopReason.HOLDER_LOST, "detail": self._lost_holder}
                return outcome.model_copy(update=told)
            return outcome

        return moved

    def _capture(self, command: CaptureStereo) -> StereoPair:
        stamp_ns, exposure_s, left, right = self._cell.camera.capture(command)
        self._bus.clock.observe(stamp_ns)
        self._captures += 1
        for publisher, frame, pixels in zip(
            self._images, (Frame.CAMERA_LEFT, Frame.CAMERA_RIGHT), (left, right), strict=True
        ):
            publisher.publish(Image(frame.value, pixels, stamp_ns))
        return StereoPair(
            stamp_ns=stamp_ns,
            capture_id=self._captures,
            calibration=self._cell.camera.calibration(),
            exposure_s=exposure_s,
        )

    def _holder_lost(self, why: str) -> None:
        self._lost_holder = why
        self._cell.arm.stop()

    def _set_payload(self, command: SetPayload) -> PayloadAccepted:
        self._desk.require(command.lease)
        self._cell.arm.set_payload(command)
        return PayloadAccepted(weight_n=command.weight_n)

    def _stop(self, command: StopMotion) -> StopAccepted:
        return StopAccepted(was_moving=self._cell.arm.stop())

    def _reset(self, simulation: Simulation, command: ResetCell) -> SimulationTruth:
        truth = simulation.reset(command)
        if self._truth is not None:
            self._truth.publish(truth)
        self._tick(self._cell.clock.now_ns())
        return truth

    def close(self) -> None:
        """Stop all motion and let go of the devices."""
        self._desk.close()
        self._cell.arm.stop()
        self._cell.close()
