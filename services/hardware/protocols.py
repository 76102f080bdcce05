"""What a device must be able to do. A driver is any class that fits: no base class, nothing to register.

SI units throughout. Motions block until they end and return what was really done; a command that cannot or must not be
done raises `crosspih_common.errors.CommandRefused` before anything moves. `stop` may be called from another thread.
Listeners are called on the device's own thread and must return at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from crosspih_common.messages import (
    AdmittanceMove,
    CameraCalibration,
    CaptureStereo,
    Dwell,
    FollowTrajectory,
    GuardedMove,
    GuardedMoveOutcome,
    JointState,
    MotionOutcome,
    MoveLinear,
    RawWrenchBatch,
    ResetCell,
    SetPayload,
    SimulationTruth,
)


class Clock(Protocol):
    """The cell's clock."""

    def now_ns(self) -> int:
        """Cell time, ns."""

    def on_tick(self, listener: Callable[[int], object]) -> None:
        """Call with the cell time about 50 times a second of cell time."""


class Arm(Protocol):
    """A 6-axis arm with its controller: position moves, and the moves that need the force beside the controller."""

    def joint_state(self) -> JointState:
        """The encoders now."""

    def on_joint_state(self, listener: Callable[[JointState], object]) -> None:
        """Call with every joint state (250 Hz of cell time)."""

    def follow(self, command: FollowTrajectory) -> MotionOutcome:
        """Follow a joint trajectory."""

    def move_linear(self, command: MoveLinear) -> MotionOutcome:
        """Move the peg frame on a straight line."""

    def guarded_move(self, command: GuardedMove) -> GuardedMoveOutcome:
        """Move until something is felt."""

    def admittance_move(self, command: AdmittanceMove) -> MotionOutcome:
        """Push in, yielding."""

    def dwell(self, command: Dwell) -> MotionOutcome:
        """Hold still and average the sensor."""

    def set_payload(self, command: SetPayload) -> None:
        """What hangs behind the sensor, so that thresholds and caps see contact only."""

    def stop(self) -> bool:
        """End whatever moves now; whether anything did."""


class ForceTorqueSensor(Protocol):
    """A wrist force/torque sensor."""

    def on_batch(self, listener: Callable[[RawWrenchBatch], object]) -> None:
        """Call with every batch of raw samples (1 kHz in batches of 10 ms)."""


class StereoCamera(Protocol):
    """Two parallel cameras."""

    def calibration(self) -> CameraCalibration:
        """What the cameras are and where they stand."""

    def capture(self, command: CaptureStereo) -> tuple[int, float, NDArray[np.uint8], NDArray[np.uint8]]:
        """Take a pair: (stamp_ns, exposure_s, left, right), each (height, width) or (height, width, 3)."""


class Simulation(Protocol):
    """What only a simulated cell can do."""

    def reset(self, command: ResetCell) -> SimulationTruth:
        """Start a new trial."""

    def truth(self) -> SimulationTruth:
        """What the simulator knows."""


class Cell(Protocol):
    """The devices of one cell, opened together."""

    @property
    def clock(self) -> Clock:
        """The cell's clock."""

    @property
    def arm(self) -> Arm:
        """The arm."""

    @property
    def force_torque(self) -> ForceTorqueSensor:
        """The sensor in its wrist."""

    @property
    def camera(self) -> StereoCamera:
        """The cameras."""

    @property
    def simulation(self) -> Simulation | None:
        """None on a real cell."""

    def close(self) -> None:
        """Stop all motion and let go of the devices."""
