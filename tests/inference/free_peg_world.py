"""A peg flying free on a virtual 6-DoF wrist spring, touching the hole in PyBullet: the engine's word on contact.

The peg is one body of 4 kg with its centre of mass at the F/T origin; a spring and damper pull it to the commanded
pose, which stands for the arm's stiffness. The world is the hole frame. Contact forces come from the engine's own
contact points, so the wrench is exact; noise is added by the caller.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece
from services.inference.mechanics.pairs import HoleShape, PegShape

pybullet = pytest.importorskip("pybullet", reason="the contacts compared here are PyBullet's")
bullet_client = pytest.importorskip("pybullet_utils.bullet_client")

STEP_S = 0.001
COLLISION_MARGIN_M = 1e-6
MASS_KG = 4.0
INERTIA_KG_M2 = 0.02


@dataclass(frozen=True)
class EngineContact:
    """One contact point in the hole frame: point (m), normal from hole to peg, normal force (N), friction on the peg
    (N), velocity of the peg there (m/s)."""

    point_m: Array
    normal: Array
    normal_n: float
    friction_n: Array
    velocity_m_s: Array


@dataclass
class FreePegWorld:
    """Peg and hole in one engine client. Stiffness: N/m in translation, Nm/rad in rotation, at the F/T origin."""

    peg: PegShape
    hole: HoleShape
    friction_coefficient: float = 0.0
    stiffness_n_m: float = 1e5
    stiffness_nm_rad: float = 1e3

    def __post_init__(self) -> None:
        self.client: Any = bullet_client.BulletClient(pybullet.DIRECT)
        self.client.setPhysicsEngineParameter(
            fixedTimeStep=STEP_S,
            numSolverIterations=50,
            contactBreakingThreshold=1e-5,
            contactSlop=0.0,
            solverResidualThreshold=0.0,
            restitutionVelocityThreshold=1e9,
        )
        self.hole_bodies = [self._static(piece) for piece in self.hole.pieces()]
        first, *others = [self._shape(piece) for piece in self.peg.pieces()]
        for shape in (first, *others):
            self._set_margin(shape)
        links = len(others)
        self.body: int = self.client.createMultiBody(
            MASS_KG,
            first,
            basePosition=[0, 0, -0.3],
            linkMasses=[1e-6] * links,
            linkCollisionShapeIndices=others,
            linkVisualShapeIndices=[-1] * links,
            linkPositions=[[0, 0, 0]] * links,
            linkOrientations=[[0, 0, 0, 1]] * links,
            linkInertialFramePositions=[[0, 0, 0]] * links,
            linkInertialFrameOrientations=[[0, 0, 0, 1]] * links,
            linkParentIndices=[0] * links,
            linkJointTypes=[pybullet.JOINT_FIXED] * links,
            linkJointAxis=[[0, 0, 1]] * links,
        )
        for link in range(-1, links):
            self.client.changeDynamics(self.body, link, lateralFriction=self.friction_coefficient)
            self.client.changeDynamics(
                self.body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, restitution=0.0,
                activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            )  # fmt: skip
            self.client.changeDynamics(self.body, link, rollingFriction=0.0, spinningFriction=0.0)
        self.client.changeDynamics(self.body, -1, localInertiaDiagonal=[INERTIA_KG_M2] * 3)
        self.client.changeDynamics(self.body, -1, lateralFriction=self.friction_coefficient)
        self.damping_ns_m = 2 * np.sqrt(self.stiffness_n_m * MASS_KG)
        self.damping_nms_rad = 2 * np.sqrt(self.stiffness_nm_rad * INERTIA_KG_M2)

    @property
    def compliance_peg(self) -> Array:
        """Twist of the peg frame per wrench on the peg (6, 6), peg frame, exact for small deflections."""
        return np.diag([1 / self.stiffness_n_m] * 3 + [1 / self.stiffness_nm_rad] * 3)

    def _shape(self, piece: ConvexPiece) -> int:
        corners = piece.inset(COLLISION_MARGIN_M).vertices_m()
        return int(self.client.createCollisionShape(pybullet.GEOM_MESH, vertices=corners.tolist()))

    def _set_margin(self, shape: int) -> None:
        # A link takes over the shape's margin, and only a base can set it: a passing body does.
        dummy = self.client.createMultiBody(0, shape)
        self.client.changeDynamics(dummy, -1, collisionMargin=COLLISION_MARGIN_M)
        self.client.removeBody(dummy)

    def _static(self, piece: ConvexPiece) -> int:
        centre = piece.interior_point_m()
        moved = ConvexPiece(piece.normals, piece.offsets_m - piece.normals @ centre)
        body = int(self.client.createMultiBody(0, self._shape(moved), basePosition=centre.tolist()))
        self.client.changeDynamics(body, -1, collisionMargin=COLLISION_MARGIN_M)
        self.client.changeDynamics(body, -1, lateralFriction=1.0)
        self.client.changeDynamics(body, -1, restitution=0.0)
        return body

    def place(self, pose_hole_peg: Pose) -> None:
        """Put the peg somewhere at rest."""
        self.client.resetBasePositionAndOrientation(
            self.body, pose_hole_peg.translation_m.tolist(), pose_hole_peg.quaternion_xyzw().tolist()
        )
        self.client.resetBaseVelocity(self.body, [0, 0, 0], [0, 0, 0])

    def pose_hole_peg(self) -> Pose:
        """Where the peg is."""
        position, quaternion = self.client.getBasePositionAndOrientation(self.body)
        return Pose.from_quaternion(quaternion, position)

    def step(self, command: Pose, command_twist_hole: Array | None = None) -> Array:
        """One millisecond towards a commanded pose that moves at (v, w) (6,); the wrist's wrench on the peg, peg
        frame."""
        position, quaternion = self.client.getBasePositionAndOrientation(self.body)
        velocity, turning = self.client.getBaseVelocity(self.body)
        twist = np.zeros(6) if command_twist_hole is None else command_twist_hole
        rotation = np.array(self.client.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        skewed = rotation.T @ command.rotation
        lag = 0.5 * np.array([skewed[2, 1] - skewed[1, 2], skewed[0, 2] - skewed[2, 0], skewed[1, 0] - skewed[0, 1]])
        force = self.stiffness_n_m * (command.translation_m - position) + self.damping_ns_m * (twist[:3] - velocity)
        moment = rotation @ (self.stiffness_nm_rad * lag) + self.damping_nms_rad * (twist[3:] - turning)
        self.client.applyExternalForce(self.body, -1, force.tolist(), position, pybullet.WORLD_FRAME)
        self.client.applyExternalTorque(self.body, -1, moment.tolist(), pybullet.WORLD_FRAME)
        self.client.stepSimulation()
        return np.concatenate([force @ rotation, moment @ rotation])

    def contacts(self) -> list[EngineContact]:
        """The contact points that carry force, with the velocity of the peg there."""
        position, _ = self.client.getBasePositionAndOrientation(self.body)
        velocity, turning = self.client.getBaseVelocity(self.body)
        found = []
        for contact in self.client.getContactPoints(bodyA=self.body):
            if contact[9] > 1e-6:
                point, normal = np.array(contact[5]), np.array(contact[7])
                friction = -contact[10] * np.array(contact[11]) - contact[12] * np.array(contact[13])
                moving = np.array(velocity) + np.cross(turning, point - position)
                found.append(EngineContact(point, normal, float(contact[9]), friction, np.asarray(moving)))
        return found

    def hulls(self) -> tuple[list[Array], list[Array]]:
        """The corners (k, 3), m, that the engine really holds, of the peg (peg frame) and of the hole (hole frame).

        It snaps them to a grid of 1/10216 of each hull's extent, towards its middle: up to 12 um for the plate.
        """
        links = range(-1, self.client.getNumJoints(self.body))
        peg = [np.array(self.client.getMeshData(self.body, link)[1]) for link in links]
        hole = [
            np.array(self.client.getMeshData(body, -1)[1]) + self.client.getBasePositionAndOrientation(body)[0]
            for body in self.hole_bodies
        ]
        return peg, hole

    def contact_wrench_peg(self) -> Array:
        """The contact wrench (6,) on the peg in the peg frame, from the engine's contact points and frictions."""
        wrench = np.zeros(6)
        pose = self.pose_hole_peg()
        for contact in self.client.getContactPoints(bodyA=self.body):
            point = np.array(contact[5])
            force = contact[9] * np.array(contact[7])
            force = force - contact[10] * np.array(contact[11]) - contact[12] * np.array(contact[13])
            wrench[:3] += force
            wrench[3:] += np.cross(point - pose.translation_m, force)
        return np.concatenate([pose.rotation.T @ wrench[:3], pose.rotation.T @ wrench[3:]])

    def contact_count(self) -> int:
        """How many contact points carry force."""
        return sum(contact[9] > 1e-6 for contact in self.client.getContactPoints(bodyA=self.body))

    def close(self) -> None:
        """Let the engine go."""
        self.client.disconnect()


@dataclass(frozen=True)
class TouchRecord:
    """What a guarded push saw: commanded and true pose at the averaging instant, the averaged wrench, engine
    contacts."""

    commanded_hole_peg: Pose
    true_hole_peg: Pose
    wrench_peg: Array
    contacts: int
    reached_n: float
    travelled_m: float


def guarded_push(
    world: FreePegWorld,
    start_hole_peg: Pose,
    direction_hole: Array,
    limit_m: float,
    force_limit_n: float = 20.0,
    moment_limit_nm: float = 2.0,
    approach_m_s: float = 0.005,
    creep_m_s: float = 0.001,
    samples: int = 25,
) -> TouchRecord:
    """Push straight until the force or moment limit, creeping once in touch; average the last samples, still
    creeping."""
    world.place(start_hole_peg)
    travelled, speed = 0.0, approach_m_s
    poses: list[Pose] = []
    commands: list[Array] = []
    wrenches: list[Array] = []
    magnitude = 0.0
    for _ in itertools.count():
        travelled += speed * STEP_S
        command = Pose(start_hole_peg.rotation, start_hole_peg.translation_m + travelled * direction_hole)
        wrist = world.step(command, np.concatenate([speed * direction_hole, np.zeros(3)]))
        magnitude = float(np.linalg.norm(wrist[:3]))
        moment = float(np.linalg.norm(wrist[3:]))
        near = magnitude > 0.85 * force_limit_n or moment > 0.85 * moment_limit_nm
        if near:
            wrenches.append(world.contact_wrench_peg())
            poses.append(world.pose_hole_peg())
            commands.append(command.translation_m)
            del wrenches[:-samples], poses[:-samples], commands[:-samples]
        if magnitude > 1.0:
            speed = creep_m_s
        done = magnitude > force_limit_n or moment > moment_limit_nm
        if (done and len(wrenches) == samples) or travelled > limit_m:
            break
    if not wrenches:
        wrenches, poses, commands = [world.contact_wrench_peg()], [world.pose_hole_peg()], [command.translation_m]
    middle = poses[len(poses) // 2]
    return TouchRecord(
        Pose(start_hole_peg.rotation, np.mean(commands, axis=0)),
        Pose(middle.rotation, np.mean([pose.translation_m for pose in poses], axis=0)),
        np.mean(wrenches, axis=0),
        world.contact_count(),
        magnitude,
        travelled,
    )
