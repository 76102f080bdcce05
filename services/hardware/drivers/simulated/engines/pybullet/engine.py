"""The physics of the cell: the elastic arm, the payload behind the sensor, the hole, one millisecond at a time.

The joints are elastic: the motor side follows its reference exactly, the link side hangs on it by spring and damper,

    tau = K (q_motor - q) + D (v_motor - v) + M(q) a_motor + h(q, v)

with gravity and inertia fed forward, so that only contact bends the arm at rest. K is the work cell's joint stiffness;
D_i = 2 zeta sqrt(K_i M_ii), M_ii in front of the hole. While the motor creeps at v against a wall the damper adds about
D v to K's force: with zeta = 0.5 (the default) that is an apparent deflection of some 3 to 7 micrometres at 1 mm/s.
What the change from approach to creep sets ringing (15 to 45 Hz) has died out after some 70 ms: observe for 0.1 s or
more. PyBullet's torque control is explicit, hence 1 kHz.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pybullet

from crosspih_common.arm.inverse import nearest
from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.pybullet import bodies
from services.hardware.drivers.simulated.truth import SensorMounting, true_hole, true_peg, true_stiffness_nm_rad

STEP_NS = 1_000_000
STEP_S = 1e-3
_JOINTS = list(range(6))
_WITH_SENSOR = list(range(7))


@dataclass(frozen=True, slots=True)
class ContactPoint:
    """One contact: where, and the force on the peg, friction included; both (3,) in the base frame, m and N."""

    point_base_m: Array
    force_base_n: Array


class Physics:
    """One PyBullet client. One thread at a time."""

    def __init__(self, workcell: Workcell, config: SimulatedConfig) -> None:
        self._workcell = workcell
        self._config = config
        self._arm_model = workcell.arm()
        peg_pieces: list[ConvexPiece] = true_peg(workcell, config.truth).pieces()
        self._pieces = bodies.corners(peg_pieces)
        self._blocks = bodies.corners(true_hole(workcell, config.truth).pieces())
        self._mounting = SensorMounting(config.truth)
        self._centroid_m = np.asarray(config.force_torque.payload_centroid_m, float)
        self._stiffness = true_stiffness_nm_rad(workcell, config.truth)
        self._client = int(pybullet.connect(pybullet.DIRECT))
        if self._client < 0:
            raise RuntimeError("PyBullet gives no physics client; too many are open in this process")
        self._arm = -1
        self.joints_rad = np.zeros(6)
        self._speeds_rad_s = np.zeros(6)
        self._reaction: tuple[float, ...] = (0.0,) * 6
        self._damping = np.zeros(6)
        nominal = workcell.hole_prior.pose_base_hole() @ workcell.pose_flange_peg().inverse()
        self._nominal_joints_rad = nearest(self._arm_model, nominal, workcell.home_joints_rad)

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
        self._arm = bodies.add_arm(
            self._arm_model, self._workcell.pose_flange_peg(), self._pieces,
            self._config.force_torque.payload_kg, self._centroid_m, client,
        )  # fmt: skip
        # The friction of a pair is the product of the two.
        bodies.set_peg_friction(self._arm, self._config.friction_coefficient, client)
        bodies.add_hole(self._blocks, pose_base_hole, 1.0, client)
        mass = np.array(
            pybullet.calculateMassMatrix(self._arm, self._nominal_joints_rad.tolist(), physicsClientId=client)
        )
        self._damping = 2.0 * self._config.joint_damping_ratio * np.sqrt(self._stiffness * np.diag(mass))
        for joint, angle in enumerate(joints_rad):
            pybullet.resetJointState(self._arm, joint, float(angle), 0.0, physicsClientId=client)
        self._read()

    def step(self, joints_rad: Array, speeds_rad_s: Array, accelerations_rad_s2: Array) -> None:
        """One millisecond with the motor side at a reference; each (6,)."""
        client = self._client
        torque = pybullet.calculateInverseDynamics(
            self._arm, self.joints_rad.tolist(), self._speeds_rad_s.tolist(), accelerations_rad_s2.tolist(),
            physicsClientId=client,
        )  # fmt: skip
        torque = (
            torque
            + self._stiffness * (joints_rad - self.joints_rad)
            + self._damping * (speeds_rad_s - self._speeds_rad_s)
        )
        pybullet.setJointMotorControlArray(
            self._arm, _JOINTS, pybullet.TORQUE_CONTROL, forces=torque.tolist(), physicsClientId=client
        )
        pybullet.stepSimulation(physicsClientId=client)
        self._read()

    def _read(self) -> None:
        states = pybullet.getJointStates(self._arm, _WITH_SENSOR, physicsClientId=self._client)
        self.joints_rad = np.array([state[0] for state in states[:6]])
        self._speeds_rad_s = np.array([state[1] for state in states[:6]])
        self._reaction = states[6][2]

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

    @property
    def _lever_m(self) -> tuple[float, float, float]:
        scale = self._config.force_torque.payload_kg / (self._config.force_torque.payload_kg - bodies.PIECES_KG)
        x, y, z = self._config.force_torque.payload_centroid_m
        return x * scale, y * scale, z * scale

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
