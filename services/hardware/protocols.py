"""What a device must be able to do: read and, for an arm, write. Everything that is motion is the control layer's.

A driver is any class that fits: no base class, nothing to inherit. SI units throughout; stamps are nanoseconds of the
device's own clock, which for the joints is the cell's clock. Rates are the device's own; nothing here is assumed of
them. `services/hardware/drivers/registry.py` says how a driver is found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from crosspih_common.arm import ArmModel
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, ResetCell, SimulationTruth
from crosspih_common.messages.images import Pixels

# The two readings are made anew in every cycle, and nobody writes to them; to freeze a dataclass makes each field of it
# several times as dear.


@dataclass(slots=True, eq=False)
class JointReading:
    """The encoders in one cycle: positions (n,), rad, and speeds (n,), rad/s."""

    stamp_ns: int
    positions_rad: Array
    speeds_rad_s: Array


@dataclass(slots=True, eq=False)
class WrenchSamples:
    """What the sensor gave since the last read, oldest first: stamps (m,), ns, and raw wrenches (m, 6), N and Nm.

    Raw is as the sensor says it, in its own axes about its own origin, bias and weight included.
    """

    stamps_ns: NDArray[np.int64]
    wrenches: Array


@dataclass(frozen=True, slots=True)
class Landing:
    """What a tip that hits a hard plate is stopped by, and what stops with it: it presses with v sqrt(k m)."""

    moved_mass_kg: float
    contact_stiffness_n_m: float


@dataclass(frozen=True, slots=True, eq=False)
class StereoCapture:
    """A pair of pictures, each (height, width) or (height, width, 3), uint8 or uint16, and when they were exposed.

    The encodings are those of docs/wire.md; left out they are mono8, mono16 or rgb8 by the picture's shape. Cameras
    that do not know the cell's clock say `host_ns`, time.monotonic_ns() when the exposure began, and -1 as `stamp_ns`.
    """

    stamp_ns: int
    exposure_s: float
    left: Pixels
    right: Pixels
    left_encoding: str = ""
    right_encoding: str = ""
    host_ns: int | None = None


class JointDevice(Protocol):
    """An arm's joints under position control. Called from one thread."""

    @property
    def model(self) -> ArmModel:
        """Kinematics and limits of the arm that is there."""

    @property
    def period_s(self) -> float:
        """The time of one cycle: 0.008, 0.004, 0.002 or 0.001 on arms that one can buy."""

    def read(self) -> JointReading:
        """Wait for the next cycle; what the encoders say in it. Raises DeviceLost when the arm no longer answers."""

    def write(self, positions_rad: Array, speeds_rad_s: Array) -> None:
        """Where the joints (n,) are to be in the next cycle, and how fast they pass there."""

    def halt(self) -> None:
        """Stop as fast as the arm itself can, and stay: the loop has ended or cannot go on. Any thread may call."""


class WrenchDevice(Protocol):
    """A wrist force/torque sensor. Called from the thread that reads the joints."""

    @property
    def period_s(self) -> float:
        """The time between two samples."""

    def read(self) -> WrenchSamples:
        """The samples that came since the last read, none if there were none; never waits."""


class CameraDevice(Protocol):
    """Two cameras that see the hole."""

    @property
    def exposure_s(self) -> float:
        """The usual exposure."""

    def calibration(self) -> CameraCalibration:
        """What the cameras are and where they stand."""

    def capture(self, exposure_scale: float, lamp: int) -> StereoCapture:
        """Take a pair: the usual exposure times a factor, with one of the cell's lamps lit, 0 being the usual one."""


class Simulation(Protocol):
    """What only a simulated cell can do."""

    def reset(self, command: ResetCell) -> SimulationTruth:
        """Start a new trial. Raises CommandRefused: not_finite, unreachable, peg_in_contact."""

    def truth(self) -> SimulationTruth:
        """What the simulator knows."""


@dataclass(slots=True, eq=False)
class Devices:
    """The devices that one process has opened; None is what another process has.

    `realtime` is False only for a simulated cell whose time stands still between commands. `landing` is what the driver
    of the arm knows of its mass and contacts; the cell's file goes before it (`hardware.limits`). `host_stamped`: the
    wrench's stamps are `time.monotonic_ns()` of this machine, to be put on the clock of another driver's joints.
    """

    joints: JointDevice | None = None
    wrench: WrenchDevice | None = None
    camera: CameraDevice | None = None
    simulation: Simulation | None = None
    realtime: bool = True
    landing: Landing | None = None
    host_stamped: bool = False
    close: Callable[[], None] = lambda: None
