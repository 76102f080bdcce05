"""The arm with its peg and the fixture with its hole as PyBullet bodies.

Convex meshes in Bullet carry a margin that rounds their edges, and this peg touches with its edges. So every convex
piece is inset by a micrometre and gets a margin of a micrometre; a link only takes a margin over from the collision
shape it is given, which a body made for a moment sets.

No link masses of the XB4 are published: those here are our assumption, and light, because motors and gears sit on the
motor side of the joint springs. They set the inertia, hence how the arm rings and how hard it lands; nothing at rest
depends on them, because gravity is fed forward. Only the peg and the hole can collide.
"""

from __future__ import annotations

import numpy as np
import pybullet

from crosspih_common.arm import ArmModel
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import ConvexPiece

INSET_M = 1e-6
MARGIN_M = 1e-6
SENSOR_JOINT = 6
FIRST_PIECE_LINK = 7
# of all pieces of the peg together
PIECES_KG = 0.002

LINK_KG = (3.0, 2.0, 1.5, 0.7, 0.5, 0.2)
# inertia added about each joint's own axis; without it the light wrist links are too fast for a 1 kHz explicit loop
JOINT_KG_M2 = (0.3, 0.3, 0.2, 0.1, 0.1, 0.05)
ZERO_AXES = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0))


def joint_points_m(arm: ArmModel) -> Array:
    """A point (6, 3) on each joint's axis at the zero pose, m, in the base frame."""
    a1, a2, a3 = arm.dh[:3, 2]
    d1, d4 = arm.dh[0, 1], arm.dh[3, 1]
    shoulder = np.array([a1, 0.0, d1])
    elbow = shoulder + np.array([0.0, 0.0, a2])
    wrist = elbow + np.array([d4, 0.0, a3])
    return np.array([np.zeros(3), shoulder, elbow, elbow + np.array([0.0, 0.0, a3]), wrist, wrist])


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


def add_arm(
    arm: ArmModel, pose_flange_peg: Pose, pieces: list[Corners], payload_kg: float, centroid_m: Array, client: int
) -> int:
    """The arm as one body: links 0-5 turn, 6 is the sensor with its payload, from 7 on they are the peg's pieces.

    At the zero pose the frames of links 0-5 are parallel to the base; those from 6 on are the peg frame {J}.
    `centroid_m` (3,) is the payload's, in the peg frame.
    """
    points = joint_points_m(arm)
    at_zero = arm.pose_base_flange(np.zeros(6)) @ pose_flange_peg
    # the middle of each link, from its own joint
    ends = np.vstack([points[1:], arm.pose_base_flange(np.zeros(6)).translation_m])
    middles = (ends - points) / 2.0
    shapes = [_with_margin(_hull(piece, client), client) for piece in pieces]
    count = len(shapes)
    piece_kg = PIECES_KG / count
    # The pieces' masses stay at the peg frame's origin (an offset would wrap their hulls and lose the margin), and the
    # sensor link makes up for them.
    sensor_kg = payload_kg - PIECES_KG
    none = [np.zeros(3)] * count
    offsets = [*middles, np.asarray(centroid_m, float) * (payload_kg / sensor_kg), *none]
    positions = [points[0], *np.diff(points, axis=0), at_zero.translation_m - points[5], *none]
    still = [0.0, 0.0, 0.0, 1.0]
    body = pybullet.createMultiBody(
        baseMass=0.0,
        basePosition=[0.0, 0.0, 0.0],
        linkMasses=[*LINK_KG, sensor_kg, *[piece_kg] * count],
        linkCollisionShapeIndices=[-1] * 7 + shapes,
        linkVisualShapeIndices=[-1] * (7 + count),
        linkPositions=[position.tolist() for position in positions],
        linkOrientations=[still] * 6 + [at_zero.quaternion_xyzw().tolist()] + [still] * count,
        linkInertialFramePositions=[offset.tolist() for offset in offsets],
        linkInertialFrameOrientations=[still] * (7 + count),
        linkParentIndices=[0, 1, 2, 3, 4, 5, 6] + [SENSOR_JOINT + 1] * count,
        linkJointTypes=[pybullet.JOINT_REVOLUTE] * 6 + [pybullet.JOINT_FIXED] * (1 + count),
        linkJointAxis=[*ZERO_AXES, (0, 0, 1), *[(0, 0, 1)] * count],
        physicsClientId=client,
    )
    _set_dynamics(int(body), middles, payload_kg, piece_kg, client)
    return int(body)


def piece_links(body: int, client: int) -> range:
    """The links of an arm's body that are the peg's pieces."""
    return range(FIRST_PIECE_LINK, int(pybullet.getNumJoints(body, physicsClientId=client)))


def _set_dynamics(body: int, middles: Array, payload_kg: float, piece_kg: float, client: int) -> None:
    for link in range(piece_links(body, client).stop):
        if link < 6:
            reach = float(np.linalg.norm(middles[link]) * 2.0)
            inertia = np.full(3, LINK_KG[link] * (reach**2 + 0.1**2) / 12.0)
            inertia += (1.0 + np.array(ZERO_AXES[link])) / 2.0 * JOINT_KG_M2[link]  # a disc across the axis
        else:
            # a payload the size of a fist; the pieces weigh next to nothing
            inertia = np.full(3, payload_kg * 0.06**2 / 6.0 if link == SENSOR_JOINT else piece_kg * 0.05**2 / 6.0)
        pybullet.changeDynamics(
            body, link, localInertiaDiagonal=inertia.tolist(), linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
            restitution=0.0, physicsClientId=client,
        )  # fmt: skip
    pybullet.changeDynamics(
        body, -1, linearDamping=0.0, angularDamping=0.0,
        activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING, physicsClientId=client,
    )  # fmt: skip
    pybullet.setJointMotorControlArray(
        body, list(range(6)), pybullet.VELOCITY_CONTROL, forces=[0.0] * 6, physicsClientId=client
    )
    pybullet.enableJointForceTorqueSensor(body, SENSOR_JOINT, True, physicsClientId=client)


def set_peg_friction(body: int, friction: float, client: int) -> None:
    """Friction of the peg's pieces, in a call of its own: together with damping or margin it is silently dropped."""
    for link in piece_links(body, client):
        pybullet.changeDynamics(body, link, lateralFriction=friction, physicsClientId=client)
        pybullet.changeDynamics(body, link, spinningFriction=0.0, rollingFriction=0.0, physicsClientId=client)
        got = pybullet.getDynamicsInfo(body, link, physicsClientId=client)[1]
        if abs(got - friction) > 1e-12:
            raise RuntimeError(f"the simulator kept friction {got} on peg piece {link}, wanted {friction}")


def _with_margin(shape: int, client: int) -> int:
    dummy = pybullet.createMultiBody(0.0, shape, physicsClientId=client)
    pybullet.changeDynamics(dummy, -1, collisionMargin=MARGIN_M, physicsClientId=client)
    pybullet.removeBody(dummy, physicsClientId=client)
    return shape
