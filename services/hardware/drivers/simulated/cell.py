"""The simulated cell: one clock, one arm, one sensor, one pair of cameras, one hole that a seed places."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np

from crosspih_common.arm.inverse import InverseError, nearest
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose, wrench_of_force_at_point
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import RawWrenchBatch, ResetCell, SimulationTruth
from crosspih_common.messages.base import PoseData, floats
from crosspih_common.messages.simulation import TrueContact
from services.hardware.config import HardwareConfig
from services.hardware.control.arm import SimulatedArm
from services.hardware.control.paths import refuse_not_finite
from services.hardware.control.servo import Servo
from services.hardware.control.turn import Turn
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.protocol import Physics
from services.hardware.drivers.simulated.engines.registry import AUTO, open_engine
from services.hardware.drivers.simulated.scene.stereo import SimulatedStereoCamera
from services.hardware.drivers.simulated.sensor import SensorModel

OVERLAP_M = 2e-5
_SLEEP_AHEAD_S = 0.002
_GIVE_UP_BEHIND_S = 0.5


class SimulatedClock:
    """Implements the Clock protocol."""

    def __init__(self, servo: Servo) -> None:
        self._servo = servo

    def now_ns(self) -> int:
        """Cell time, ns."""
        return self._servo.now_ns

    def on_tick(self, listener: Callable[[int], object]) -> None:
        """Every 20 ms of cell time."""
        self._servo.on_tick(listener)


class SimulatedForceTorque:
    """Implements the ForceTorqueSensor protocol."""

    def __init__(self, servo: Servo) -> None:
        self._servo = servo

    def on_batch(self, listener: Callable[[RawWrenchBatch], object]) -> None:
        """Every 10 ms of cell time."""
        self._servo.on_batch(listener)


class WallPace:
    """Keeps the cell's clock from running ahead of the wall's."""

    def __init__(self) -> None:
        self._anchor_s: float | None = None
        self._anchor_ns = 0

    def __call__(self, now_ns: int) -> None:
        """Wait until the wall clock has come as far. After a long stall it goes on from where it is."""
        wall_s = time.monotonic()
        if self._anchor_s is None:
            self._anchor_s, self._anchor_ns = wall_s, now_ns
            return
        ahead_s = (now_ns - self._anchor_ns) * 1e-9 - (wall_s - self._anchor_s)
        if ahead_s < -_GIVE_UP_BEHIND_S:
            self._anchor_s, self._anchor_ns = wall_s, now_ns
        elif ahead_s > _SLEEP_AHEAD_S:
            time.sleep(ahead_s)


class SimulatedSimulation:
    """Implements the Simulation protocol: new trials, and the truth about them."""

    def __init__(
        self, workcell: Workcell, config: SimulatedConfig, physics: Physics, servo: Servo, arm: SimulatedArm,
        camera: SimulatedStereoCamera,
    ) -> None:  # fmt: skip
        self._workcell = workcell
        self._arm_model = workcell.arm()
        self._physics = physics
        self._servo = servo
        self._arm = arm
        self._camera = camera
        self._seed = config.seed
        self.pose_base_hole = Pose.identity()
        # for the wire; told 50 times a second, and the same for a whole trial
        self._told_base_hole = PoseData.of(self.pose_base_hole)
        self._begin(ResetCell(seed=config.seed))

    def reset(self, command: ResetCell) -> SimulationTruth:
        """A new trial. Raises CommandRefused: busy, not_finite, unreachable, peg_in_contact."""
        with self._arm.exclusively():
            self._begin(command)
            return self.truth()

    def truth(self) -> SimulationTruth:
        """The hole's pose, the peg's (link side), and the contacts at the last step."""
        with self._servo.lock:
            pose = self._physics.pose_base_peg()
            contacts = self._physics.contacts()
            stamp_ns = self._servo.now_ns
        into_peg = pose.inverse()
        wrench = np.zeros(6)
        for contact in contacts:
            wrench += wrench_of_force_at_point(
                into_peg.rotate(contact.force_base_n), into_peg.apply(contact.point_base_m)
            )
        return SimulationTruth(
            stamp_ns=stamp_ns,
            seed=self._seed,
            pose_base_hole=self._told_base_hole,
            pose_base_peg=PoseData.of(pose),
            wrench_contact=floats(wrench),
            contacts=tuple(
                TrueContact(point_base_m=floats(contact.point_base_m), force_base_n=floats(contact.force_base_n))
                for contact in contacts
            ),
        )

    def _begin(self, command: ResetCell) -> None:
        # Streams of their own: a longer trial must not change the next one's hole, nor a picture the noise.
        hole_rng, sensor_rng, camera_rng = (
            np.random.default_rng(stream) for stream in np.random.SeedSequence(command.seed).spawn(3)
        )
        prior = self._workcell.hole_prior
        offset = hole_rng.uniform(-prior.half_ranges(), prior.half_ranges())
        if command.offset_hole is not None:
            refuse_not_finite("offset_hole", command.offset_hole)
            offset = np.asarray(command.offset_hole, float)
        pose_base_hole = prior.pose_base_hole() @ Pose.from_rotvec(offset[3:], offset[:3])
        joints = np.asarray(self._workcell.home_joints_rad, float)
        if command.place_peg is not None:
            joints = self._joints_at(pose_base_hole @ command.place_peg.pose())
        with self._servo.lock:
            self._physics.build(pose_base_hole, joints)
            overlap_m = self._physics.deepest_penetration_m()
            if overlap_m > OVERLAP_M:
                self._physics.build(self.pose_base_hole, self._servo.joints_rad)
                raise CommandRefused(
                    "peg_in_contact", f"place_peg puts the peg {overlap_m * 1e3:.2f} mm into the fixture; place it free"
                )
            self._physics.build(pose_base_hole, joints)
            self.pose_base_hole = pose_base_hole
            self._told_base_hole = PoseData.of(pose_base_hole)
            self._seed = command.seed
            self._servo.restart(joints, sensor_rng)
        self._camera.start(pose_base_hole, camera_rng, command.scene)

    def _joints_at(self, pose_base_peg: Pose) -> Array:
        refuse_not_finite("place_peg", [*pose_base_peg.translation_m, *pose_base_peg.rotation.ravel()])
        try:
            return nearest(
                self._arm_model,
                pose_base_peg @ self._workcell.pose_flange_peg().inverse(),
                self._workcell.home_joints_rad,
            )
        except InverseError as error:
            raise CommandRefused("unreachable", f"place_peg: {error}") from error


class SimulatedCell:
    """Implements the Cell protocol. Get one by `open_cell`."""

    def __init__(self, workcell: Workcell, config: SimulatedConfig, realtime: bool, engine: str = AUTO) -> None:
        self._physics = open_engine(engine, workcell, config)
        self._servo = Servo(workcell, self._physics, SensorModel(config.force_torque))
        turn = Turn()
        self.clock = SimulatedClock(self._servo)
        self.arm = SimulatedArm(workcell, config, self._servo, turn)
        self.force_torque = SimulatedForceTorque(self._servo)
        self.camera = SimulatedStereoCamera(workcell, config, self._servo, self.arm)
        self.simulation = SimulatedSimulation(workcell, config, self._physics, self._servo, self.arm, self.camera)
        self._closing = threading.Event()
        self._idler: threading.Thread | None = None
        if realtime:
            self._servo.set_pace(WallPace())
            self._idler = threading.Thread(target=self._idle, name="cell-clock", daemon=True)
            self._idler.start()

    def _idle(self) -> None:
        while not self._closing.is_set():
            self.arm.idle_step()

    def close(self) -> None:
        """Stop all motion; a second call does nothing."""
        self.arm.stop()
        self._closing.set()
        if self._idler is not None:
            self._idler.join()
            self._idler = None
        with self.arm.between_motions():
            self.camera.close()
            self._physics.close()


def open_cell(workcell: Workcell, config: HardwareConfig, realtime: bool) -> SimulatedCell:
    """The simulated cell, a `crosspih` Cell. With `realtime` its clock keeps to the wall's and never stands still;
    without, it advances only while a command runs.
    """
    return SimulatedCell(workcell, config.simulated, realtime, config.engine)
