"""The sequence network's features of a touch, and the symmetries of the peg that must not change its answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Peg

# scales that bring the features to order one
LATERAL_M, DEPTH_M, ANGLE_RAD, LEVER_M, FORCE_N, OFF_AXIS = 0.005, 0.01, 0.05, 0.02, 20.0, 0.1
FEATURES = 32


@dataclass(frozen=True, slots=True, eq=False)
class TouchHistory:
    """Touches (..., K) seen from the prior's hole frame {P}.

    rotation (..., K, 3, 3) and translation_m (..., K, 3): the peg's pose in {P}, with its deflection under the wrench;
    wrench (..., K, 6): on the peg, peg frame, N and Nm; direction (..., K, 3): unit motion in {P}; prior_sd
    (..., 6): of the hole about {P}, m and rad.
    """

    rotation: Array
    translation_m: Array
    wrench: Array
    direction: Array
    prior_sd: Array

    def turned(self, symmetry: Array) -> TouchHistory:
        """The same touches under a symmetry (..., 3, 3) of peg and hole, a rotation or a reflection (`symmetries`)."""
        every = symmetry[..., None, :, :]
        axial = every * np.linalg.det(every)[..., None, None]

        def turn(matrix: Array, vectors: Array) -> Array:
            return np.asarray(np.einsum("...ij,...j->...i", matrix, vectors))

        return TouchHistory(
            every @ self.rotation @ np.swapaxes(every, -1, -2),
            turn(every, self.translation_m),
            np.concatenate([turn(every, self.wrench[..., :3]), turn(axial, self.wrench[..., 3:])], axis=-1),
            turn(every, self.direction),
            turn_sd(symmetry, self.prior_sd),
        )


def turn_pose_error(symmetry: Array, error: Array) -> Array:
    """A pose error (..., 6), translation and rotation vector, under a symmetry (..., 3, 3): a reflection reverses the
    sense of rotations."""
    axial = symmetry * np.linalg.det(symmetry)[..., None, None]
    parts = [np.einsum("...ij,...j->...i", m, e) for m, e in ((symmetry, error[..., :3]), (axial, error[..., 3:]))]
    return np.concatenate(parts, axis=-1)


def turn_sd(symmetry: Array, sd: Array) -> Array:
    """Standard deviations (..., 6) under a symmetry (..., 3, 3); exact where x and y have equal ones."""
    parts = [np.einsum("...ij,...j->...i", symmetry**2, part**2) for part in (sd[..., :3], sd[..., 3:])]
    return np.asarray(np.sqrt(np.concatenate(parts, axis=-1)))


def symmetries(peg: Peg) -> Array:
    """The rotations and reflections (S, 3, 3) about the peg's axis that keep its section, the identity first.

    Candidates are rotations by multiples of 90 and 60 degrees, and their reflections.
    """
    corners = peg.outline_m(peg.body_start_m)
    kept = []
    for mirror in (1.0, -1.0):
        for degrees in sorted({*range(0, 360, 90), *range(0, 360, 60)}):
            turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix() @ np.diag([1.0, mirror, 1.0])
            apart = np.linalg.norm((corners @ turn.T)[:, None] - corners[None], axis=-1)
            if apart.min(axis=1).max() < 1e-6:
                kept.append(np.round(turn, 15))
    return np.array(kept)


def touch_features(peg: Peg, history: TouchHistory) -> Array:
    """Features (..., K, FEATURES) of order one.

    The peg's position and orientation in {P} at the middle of the taper, the force's direction in both frames, its
    lever about that middle, its size, the motion's direction, the point where the line of action passes a taper edge,
    in both frames, its distance from the edge, and the prior's sd.
    """
    tips, bodies = peg.taper_edges_m()
    middle = np.array([0.0, 0.0, 0.5 * (peg.taper_start_m + peg.tip_m)])
    force, moment = history.wrench[..., :3], history.wrench[..., 3:]
    size = np.maximum(np.linalg.norm(force, axis=-1, keepdims=True), 1e-9)
    along = force / size
    lever = (moment - np.cross(middle, force)) / size
    point, miss_m = _edge_point(tips, bodies, along, np.cross(along, moment / size))
    lengths = np.array([LATERAL_M, LATERAL_M, DEPTH_M])

    def to_prior(vectors: Array) -> Array:
        return np.asarray(np.einsum("...ij,...j->...i", history.rotation, vectors))

    rotvec = Rotation.from_matrix(history.rotation.reshape(-1, 3, 3)).as_rotvec().reshape(along.shape)
    rim = np.array([0.0, 0.0, middle[2]])
    place = history.translation_m + to_prior(np.broadcast_to(middle, along.shape))
    touched = history.translation_m + to_prior(point)
    sd = np.log(np.maximum(history.prior_sd, 1e-6) / np.array([1e-3] * 3 + [0.02] * 3))[..., None, :] / 2.0
    parts = [
        place / lengths,
        rotvec / ANGLE_RAD,
        along,
        to_prior(along),
        lever / LEVER_M,
        np.log(size / FORCE_N),
        (history.direction - np.array([0.0, 0.0, 1.0])) / OFF_AXIS,
        (point - rim) / LEVER_M,
        touched / LEVER_M,
        np.log(np.maximum(miss_m, 1e-5) / 1e-3)[..., None] / 3.0,
        np.broadcast_to(sd[..., :1, :], (*along.shape[:-1], 6)),
    ]
    return np.concatenate(parts, axis=-1).astype(np.float32)


def _edge_point(tips: Array, bodies: Array, along: Array, nearest: Array) -> tuple[Array, Array]:
    """Where a line (direction `along`, through `nearest`, both (..., 3)) passes closest to any of the edges between
    tips and bodies (E, 3): the point (..., 3) of that edge and the distance (...), m, peg frame."""
    span = bodies - tips
    between = nearest[..., None, :] - tips
    b = np.einsum("...i,ei->...e", along, span)
    d = np.einsum("...i,...ei->...e", along, between)
    e = np.einsum("ei,...ei->...e", span, between)
    c = np.einsum("ei,ei->e", span, span)
    share = np.clip((e - b * d) / np.maximum(c - b * b, 1e-12), 0.0, 1.0)
    points = tips + share[..., None] * span
    off = points - nearest[..., None, :]
    off = off - np.einsum("...ei,...i->...e", off, along)[..., None] * along[..., None, :]
    distance = np.linalg.norm(off, axis=-1)
    best = distance.argmin(axis=-1)[..., None]
    point = np.take_along_axis(points, best[..., None], axis=-2)[..., 0, :]
    return point, np.take_along_axis(distance, best, axis=-1)[..., 0]
