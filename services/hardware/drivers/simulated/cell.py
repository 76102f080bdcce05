"""The simulated cell: one world, its arm, its sensor, its cameras, and a hole that a seed places."""

from __future__ import annotations

import sys

import numpy as np

from crosspih_common.arm.inverse import InverseError, nearest
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose, wrench_of_force_at_point
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import ResetCell, SimulationTruth
from crosspih_common.messages.base import PoseData, floats
from crosspih_common.messages.simulation import TrueContact
from services.hardware.drivers.registry import OpenRequest
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.registry import chosen_engine, open_engine
from services.hardware.drivers.simulated.scene.stereo import SimulatedStereoCamera
from services.hardware.drivers.simulated.world import SimulatedJoints, SimulatedWrench, World
from services.hardware.protocols import Devices, Landing

OVERLAP_M = 2e-5


class SimulatedTrials:
    """Implements the Simulation protocol: new trials, and the truth about them."""

    def __init__(
        self, workcell: Workcell, config: SimulatedConfig, world: World, camera: SimulatedStereoCamera
    ) -> None:
        self._workcell = workcell
        self._arm_model = workcell.arm()
        self._world = world
        self._camera = camera
        self._seed = config.seed
        self.pose_base_hole = Pose.identity()
        # for the wire; told 50 times a second, and the same for a whole trial
        self._told_base_hole = PoseData.of(self.pose_base_hole)
        self.reset(ResetCell(seed=config.seed))

    def truth(self) -> SimulationTruth:
        """The hole's pose, the peg's (link side), and the contacts at the last step."""
        with self._world.lock:
            pose = self._world.engine.pose_base_peg()
            contacts = self._world.engine.contacts()
            stamp_ns, peak_contact_n = self._world.now_ns, self._world.peak_contact_n
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
            peak_contact_n=peak_contact_n,
        )

    def reset(self, command: ResetCell) -> SimulationTruth:
        """A new trial. Raises CommandRefused: not_finite, unreachable, peg_in_contact."""
        # Streams of their own: a longer trial must not change the next one's hole, nor a picture the noise.
        hole_rng, sensor_rng, camera_rng = (
            np.random.default_rng(stream) for stream in np.random.SeedSequence(command.seed).spawn(3)
        )
        prior = self._workcell.hole_prior
        offset = hole_rng.uniform(-prior.half_ranges(), prior.half_ranges())
        if command.offset_hole is not None:
            _refuse_not_finite("offset_hole", command.offset_hole)
            offset = np.asarray(command.offset_hole, float)
        pose_base_hole = prior.pose_base_hole() @ Pose.from_rotvec(offset[3:], offset[:3])
        joints = np.asarray(self._workcell.home_joints_rad, float)
        if command.place_peg is not None:
            joints = self._joints_at(pose_base_hole @ command.place_peg.pose())
        world = self._world
        with world.lock:
            world.engine.build(pose_base_hole, joints)
            overlap_m = world.engine.deepest_penetration_m()
            if overlap_m > OVERLAP_M:
                world.engine.build(self.pose_base_hole, world.joints_rad)
                raise CommandRefused(
                    "peg_in_contact", f"place_peg puts the peg {overlap_m * 1e3:.2f} mm into the fixture; place it free"
                )
            world.start(pose_base_hole, joints, sensor_rng)
            self.pose_base_hole = pose_base_hole
            self._told_base_hole = PoseData.of(pose_base_hole)
            self._seed = command.seed
        self._camera.start(pose_base_hole, camera_rng, command.scene)
        return self.truth()

    def _joints_at(self, pose_base_peg: Pose) -> Array:
        _refuse_not_finite("place_peg", [*pose_base_peg.translation_m, *pose_base_peg.rotation.ravel()])
        try:
            return nearest(
                self._arm_model,
                pose_base_peg @ self._workcell.pose_flange_peg().inverse(),
                self._workcell.home_joints_rad,
            )
        except InverseError as error:
            raise CommandRefused("unreachable", f"place_peg: {error}") from error


def _refuse_not_finite(name: str, values: object) -> None:
    if not np.all(np.isfinite(np.asarray(values, float))):
        raise CommandRefused("not_finite", f"{name} holds {values}, want finite numbers")


def open_devices(request: OpenRequest) -> Devices:
    """The simulated cell's devices. In real time its clock keeps to the wall's; else time goes by only in the cycles
    that the arm's loop asks for. A camera or a sensor alone sees a cell whose arm never moves.
    """
    workcell, simulated = request.workcell, request.config.simulated
    engine = chosen_engine(request.config.engine)
    print(f"simulated cell: physics by {engine}", file=sys.stderr, flush=True)
    # a correction is what was found of the sensor: the simulated one stays as it is
    drawn = workcell.force_torque.as_drawn().mounting(workcell.pose_flange_peg())
    world = World(open_engine(engine, workcell, simulated), simulated, drawn, request.realtime)
    camera = SimulatedStereoCamera(workcell, simulated, world)
    trials = SimulatedTrials(workcell, simulated, world, camera)

    def close() -> None:
        camera.close()
        world.engine.close()

    return Devices(
        joints=SimulatedJoints(world, workcell.arm()),
        wrench=SimulatedWrench(world),
        camera=camera,
        simulation=trials,
        realtime=request.realtime,
        landing=Landing(simulated.landing_mass_kg, simulated.landing_stiffness_n_m),
        close=close,
    )
