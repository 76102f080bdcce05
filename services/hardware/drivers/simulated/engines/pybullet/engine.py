"""The cell in PyBullet, one millisecond at a time. PyBullet's torque control is explicit, hence 1 kHz."""

from __future__ import annotations

import numpy as np
import pybullet

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.arm_bodies import arm_bodies, nominal_joints_rad
from services.hardware.drivers.simulated.engines.protocol import CONTACT_DAMPING_S, STEP_S, ContactPoint
from services.hardware.drivers.simulated.engines.pybullet import bodies
from services.hardware.drivers.simulated.truth import TrueSensorMounting, true_hole, true_pieces, true_stiffness_nm_rad


class PybulletPhysics:
    """Implements the Physics protocol by one PyBullet client. One thread at a time."""

    def __init__(self, workcell: Workcell, config: SimulatedConfig) -> None:
        self._workcell = workcell
        self._config = config
        self._bodies = arm_bodies(workcell, config)
        joints = len(self._bodies.link_kg)
        self._joints, self._with_sensor = list(range(joints)), list(range(joints + 1))
        peg_pieces: list[ConvexPiece] = true_pieces(workcell, config.truth)
        self._pieces = bodies.corners(peg_pieces)
        self._blocks = bodies.corners(true_hole(workcell, config.truth).pieces())
        self._lever_m: list[float] = self._bodies.sensor_middle_m.tolist()
        self._mounting = TrueSensorMounting(config.truth)
        self._stiffness: list[float] = true_stiffness_nm_rad(workcell, config.truth).tolist()
        self._client = int(pybullet.connect(pybullet.DIRECT))
        if self._client < 0:
            raise RuntimeError("PyBullet gives no physics client; too many are open in this process")
        self._arm = -1
        self._at, self._speeds = [0.0] * joints, [0.0] * joints
        self._reaction: tuple[float, ...] = (0.0,) * 6
        self._damping = [0.0] * joints
        self._nominal_joints_rad = nominal_joints_rad(workcell)

    def close(self) -> None:
        """Give the client back; a second call does nothing."""
        if self._client >= 0:
            pybullet.disconnect(physicsClientId=self._client)
            self._client = -1

    def build(self, pose_base_hole: Pose, joints_rad: Array) -> None:
        """Make the world anew, at rest: nothing of what was before can be felt."""
        client = self._client
        pybullet.resetSimulation(physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=STEP_S,
            numSubSteps=0,
            numSolverIterations=50,
            solverResidualThreshold=0.0,
            contactBreakingThreshold=1e-5,
            contactSlop=0.0,
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        pybullet.setGravity(*self._workcell.gravity_base_m_s2, physicsClientId=client)
        self._arm = bodies.add_arm(self._bodies, self._pieces, client)
        # The friction of a pair is the product of the two.
        bodies.set_peg_friction(self._arm, len(self._joints), self._config.friction_coefficient, client)
        blocks = bodies.add_hole(self._blocks, pose_base_hole, 1.0, client)
        contact_n_m = self._config.contact_stiffness_n_m
        if contact_n_m is not None:
            bodies.soften(blocks, contact_n_m, CONTACT_DAMPING_S * contact_n_m, client)
        mass = np.array(
            pybullet.calculateMassMatrix(self._arm, self._nominal_joints_rad.tolist(), physicsClientId=client)
        )
        ratio = self._config.joint_damping_ratio
        self._damping = (2.0 * ratio * np.sqrt(np.array(self._stiffness) * np.diag(mass))).tolist()
        for joint, angle in enumerate(joints_rad):
            pybullet.resetJointState(self._arm, joint, float(angle), 0.0, physicsClientId=client)
        self._read()

    def step(self, joints_rad: Array, speeds_rad_s: Array, accelerations_rad_s2: Array) -> None:
        """One millisecond with the motor side at a reference; each (n,)."""
        client = self._client
        at, speeds = self._at, self._speeds
        needed = pybullet.calculateInverseDynamics(
            self._arm, at, speeds, accelerations_rad_s2.tolist(), physicsClientId=client
        )
        # floats one by one: six of them are sooner added than NumPy is called
        rows = zip(
            needed, self._stiffness, joints_rad.tolist(), at, self._damping, speeds_rad_s.tolist(), speeds, strict=True
        )
        torque = [feed + k * (goal - here) + d * (fast - now) for feed, k, goal, here, d, fast, now in rows]
        pybullet.setJointMotorControlArray(
            self._arm, self._joints, pybullet.TORQUE_CONTROL, forces=torque, physicsClientId=client
        )
        pybullet.stepSimulation(physicsClientId=client)
        self._read()

    def _read(self) -> None:
        states = pybullet.getJointStates(self._arm, self._with_sensor, physicsClientId=self._client)
        *moving, sensor = states
        self._at = [state[0] for state in moving]
        self._speeds = [state[1] for state in moving]
        self._reaction = sensor[2]

    @property
    def joints_rad(self) -> Array:
        """The link side's joints (n,)."""
        return np.array(self._at)

    def wrench_sensed(self) -> Array:
        """What an ideal sensor reads (6,), N and Nm: on the peg, in the peg frame about its origin.

        Contact, weight and inertia of all behind the sensor. PyBullet gives the reaction, with the opposite sign, and
        its moment about the link's centre of mass.
        """
        fx, fy, fz, mx, my, mz = self._reaction
        x, y, z = self._lever_m
        return self._mounting.felt(
            np.array([-fx, -fy, -fz, -mx - (y * fz - z * fy), -my - (z * fx - x * fz), -mz - (x * fy - y * fx)])
        )

    def pose_base_peg(self) -> Pose:
        """Where the peg really is: the link side."""
        return self._workcell.pose_base_peg(self.joints_rad)

    def contacts(self) -> list[ContactPoint]:
        """Every contact that carries force."""
        found = []
        for contact in pybullet.getContactPoints(bodyA=self._arm, physicsClientId=self._client):
            normal, pressed = np.array(contact[7]), contact[9]
            force = pressed * normal + contact[10] * np.array(contact[11]) + contact[12] * np.array(contact[13])
            if pressed > 0.0:
                found.append(ContactPoint(np.array(contact[5]), np.asarray(force)))
        return found

    def deepest_penetration_m(self) -> float:
        """How far peg and hole overlap as they stand, m; 0 when they do not."""
        pybullet.performCollisionDetection(physicsClientId=self._client)
        contacts = pybullet.getContactPoints(bodyA=self._arm, physicsClientId=self._client)
        return max((-float(contact[8]) for contact in contacts), default=0.0)


ENGINE = PybulletPhysics
