"""The arm with its peg and the fixture with its hole as PyBullet bodies.

Convex meshes in Bullet carry a margin that rounds their edges, and this peg touches with its edges. So every convex
piece is inset by a micrometre and gets a margin of a micrometre; a link only takes a margin over from the collision
shape it is given, which a body made for a moment sets.
"""

from __future__ import annotations

import numpy as np
import pybullet

from crosspih_common.geometry import Pose
from crosspih_common.shapes import ConvexPiece
from services.hardware.drivers.simulated.engines.arm_bodies import PIECES_KG, PIECES_SIZE_M, ArmBodies

INSET_M = 1e-6
MARGIN_M = 1e-6

Corners = list[list[float]]


def corners(pieces: list[ConvexPiece]) -> list[Corners]:
    """The corners (m) of each piece's hull, inset by what the margin puts back."""
    return [piece.inset(INSET_M).vertices_m().tolist() for piece in pieces]


def _hull(vertices: Corners, client: int) -> int:
    return int(pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=vertices, physicsClientId=client))


def add_hole(blocks: list[Corners], pose_base_hole: Pose, friction: float, client: int) -> list[int]:
    """The fixture: each convex block a static body of its own. Returns the bodies."""
    position, quaternion = pose_base_hole.translation_m.tolist(), pose_base_hole.quaternion_xyzw().tolist()
    bodies = []
    for block in blocks:
        body = pybullet.createMultiBody(0.0, _hull(block, client), -1, position, quaternion, physicsClientId=client)
        pybullet.changeDynamics(body, -1, collisionMargin=MARGIN_M, restitution=0.0, physicsClientId=client)
        pybullet.changeDynamics(
            body, -1, lateralFriction=friction, spinningFriction=0.0, rollingFriction=0.0, physicsClientId=client
        )
        bodies.append(int(body))
    return bodies


def add_arm(arm: ArmBodies, pieces: list[Corners], client: int) -> int:
    """The arm of n joints as one body: links 0 to n - 1 turn, n is the sensor with its payload, from n + 1 on they are
    the peg's pieces. At the zero pose the frames of the turning links are parallel to the base; those from n on are the
    peg frame {J}.
    """
    joints, count = len(arm.link_kg), len(pieces)
    at_zero, none = arm.pose_base_peg_zero, [np.zeros(3)] * count
    shapes = [_with_margin(_hull(piece, client), client) for piece in pieces]
    # The pieces' masses stay at the peg frame's origin: an offset would wrap their hulls and lose the margin.
    offsets = [*arm.middles_m, arm.sensor_middle_m, *none]
    positions = [
        arm.origins_m[0], *np.diff(arm.origins_m, axis=0), at_zero.translation_m - arm.origins_m[-1], *none,
    ]  # fmt: skip
    still = [0.0, 0.0, 0.0, 1.0]
    body = pybullet.createMultiBody(
        baseMass=0.0,
        basePosition=[0.0, 0.0, 0.0],
        linkMasses=[*arm.link_kg.tolist(), arm.sensor_kg, *[PIECES_KG / count] * count],
        linkCollisionShapeIndices=[-1] * (joints + 1) + shapes,
        linkVisualShapeIndices=[-1] * (joints + 1 + count),
        linkPositions=[position.tolist() for position in positions],
        linkOrientations=[still] * joints + [at_zero.quaternion_xyzw().tolist()] + [still] * count,
        linkInertialFramePositions=[offset.tolist() for offset in offsets],
        linkInertialFrameOrientations=[still] * (joints + 1 + count),
        linkParentIndices=[*range(joints + 1), *[joints + 1] * count],
        linkJointTypes=[pybullet.JOINT_REVOLUTE] * joints + [pybullet.JOINT_FIXED] * (1 + count),
        linkJointAxis=[*arm.axes.tolist(), (0, 0, 1), *[(0, 0, 1)] * count],
        physicsClientId=client,
    )
    _set_dynamics(int(body), arm, client)
    return int(body)


def piece_links(body: int, joints: int, client: int) -> range:
    """The links of the body of an arm of so many joints that are the peg's pieces."""
    return range(joints + 1, int(pybullet.getNumJoints(body, physicsClientId=client)))


def _set_dynamics(body: int, arm: ArmBodies, client: int) -> None:
    joints = len(arm.link_kg)
    pieces = piece_links(body, joints, client)
    inertias = [*arm.link_kg_m2, np.full(3, arm.sensor_kg_m2)]
    inertias += [np.full(3, PIECES_KG / len(pieces) * PIECES_SIZE_M**2 / 6.0)] * len(pieces)
    for link, inertia in enumerate(inertias):
        pybullet.changeDynamics(
            body, link, localInertiaDiagonal=inertia.tolist(), linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
            restitution=0.0, physicsClientId=client,
        )  # fmt: skip
    pybullet.changeDynamics(
        body, -1, linearDamping=0.0, angularDamping=0.0,
        activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING, physicsClientId=client,
    )  # fmt: skip
    pybullet.setJointMotorControlArray(
        body, list(range(joints)), pybullet.VELOCITY_CONTROL, forces=[0.0] * joints, physicsClientId=client
    )
    pybullet.enableJointForceTorqueSensor(body, joints, True, physicsClientId=client)


def set_peg_friction(body: int, joints: int, friction: float, client: int) -> None:
    """Friction of the peg's pieces, in a call of its own: together with damping or margin it is silently dropped."""
    for link in piece_links(body, joints, client):
        pybullet.changeDynamics(body, link, lateralFriction=friction, physicsClientId=client)
        pybullet.changeDynamics(body, link, spinningFriction=0.0, rollingFriction=0.0, physicsClientId=client)
        got = pybullet.getDynamicsInfo(body, link, physicsClientId=client)[1]
        if abs(got - friction) > 1e-12:
            raise RuntimeError(f"the simulator kept friction {got} on peg piece {link}, wanted {friction}")


def soften(blocks: list[int], stiffness_n_m: float, damping_n_s_m: float, client: int) -> None:
    """Contact points of the fixture's bodies that give way: the peg's side stays hard, and Bullet takes the pair as
    two springs in series, k = 1 / (1 / k1 + 1 / k2), whose damping adds up."""
    for block in blocks:
        pybullet.changeDynamics(
            block, -1, contactStiffness=stiffness_n_m, contactDamping=damping_n_s_m, physicsClientId=client
        )


def _with_margin(shape: int, client: int) -> int:
    dummy = pybullet.createMultiBody(0.0, shape, physicsClientId=client)
    pybullet.changeDynamics(dummy, -1, collisionMargin=MARGIN_M, physicsClientId=client)
    pybullet.removeBody(dummy, physicsClientId=client)
    return shape
