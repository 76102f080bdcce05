"""The rim in groups of profiles: an edge each, or a piece of a curve, with its outer line (face meets chamfer) and its
inner one (chamfer meets bore). Any outline: the paper's cross has 12 groups."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.stereo import StereoModel

PROFILES = 192  # across the whole rim, a picture
MIN_SAMPLES, MAX_SAMPLES = 6, 32
SKIP_ENDS = 0.13
SKIP_ENDS_M = 0.0015  # left out at the ends of a short edge: two pixels from a corner its profiles are disturbed
MAX_SKIP_ENDS = 0.4
SMOOTH_RAD = 0.2  # edges that turn by less are facets of a curve without a corner between them
PIECE_RAD = 0.55  # the largest turn of one group on a curve
SAME_DIRECTION = 0.15
PROBE_M = 1e-5


class Rimmed(Protocol):
    """A hole with its chamfer: corners of the rim, counter-clockwise, hole frame, m."""

    def inner_rim_m(self) -> Array:
        """(n, 3) where the chamfer meets the bore."""

    def outer_rim_m(self) -> Array:
        """(n, 3) where the face meets the chamfer."""


@dataclass(frozen=True, slots=True, eq=False)
class Rim:
    """Points on the rim in the hole frame: outer and inner (G, S, 3), m, their tangents and outward normals (G, S, 3),
    reach (G,): 0 for the groups nearest to the axis and 1 for the farthest; facing (G,): an index of the direction
    faced.

    `round`: a turn about the axis changes nothing on the rim.
    """

    outer_m: Array
    inner_m: Array
    along: Array
    outward: Array
    reach: Array
    facing: Array
    round: bool

    @classmethod
    def of(cls, hole: Rimmed, profiles: int = PROFILES) -> Rim:
        """The rim of a hole; the ends of each edge are left out, where the corner disturbs."""
        inner, outer = hole.inner_rim_m(), hole.outer_rim_m()
        pieces = _pieces(inner)
        samples = int(np.clip(round(profiles / len(pieces)), MIN_SAMPLES, MAX_SAMPLES))
        edge, share = (
            np.array(column) for column in zip(*(_spread(inner, piece, samples) for piece in pieces), strict=True)
        )
        ends = np.roll(inner, -1, axis=0)
        direction = ends - inner
        direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        out = np.column_stack([direction[:, 1], -direction[:, 0], np.zeros(len(inner))])
        points = inner[edge] * (1.0 - share[..., None]) + ends[edge] * share[..., None]
        # straight out from the inner point, across the chamfer, onto the face
        shift = out * np.abs(np.sum((outer - inner) * out, axis=1))[:, None]
        shift[:, 2] = outer[:, 2] - inner[:, 2]
        along, outward = direction[edge], out[edge]
        away = np.mean(np.sum(points * outward, axis=-1), axis=1)
        span = float(np.ptp(away))
        reach = (away - away.min()) / span if span > 1e-6 else np.zeros(len(away))
        middle = outward.mean(axis=1)
        smooth = bool(np.all(_turns(direction) < SMOOTH_RAD)) and span < 1e-4
        return cls(points + shift[edge], points, along, outward, reach, _facing(middle), smooth)

    def only(self, groups: NDArray[np.bool_]) -> Rim:
        """The rim without some of its groups: `groups` (G,) says which stay."""
        return replace(
            self,
            outer_m=self.outer_m[groups],
            inner_m=self.inner_m[groups],
            along=self.along[groups],
            outward=self.outward[groups],
            reach=self.reach[groups],
            facing=self.facing[groups],
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Groups, and profiles in each."""
        return self.outer_m.shape[0], self.outer_m.shape[1]


def _turns(along: Array) -> Array:
    """(n,): by how much, rad, the rim turns at the start of each edge."""
    cosine = np.clip(np.sum(along * np.roll(along, 1, axis=0), axis=1), -1.0, 1.0)
    return np.asarray(np.arccos(cosine))


def _pieces(inner: Array) -> list[tuple[list[int], bool, bool]]:
    """The groups: edge indices in order, and whether the rim has a corner at the group's start and at its end."""
    direction = np.roll(inner, -1, axis=0) - inner
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    turns = _turns(direction)
    count = len(inner)
    corners = np.flatnonzero(turns >= SMOOTH_RAD)
    first = int(corners[0]) if len(corners) else 0
    pieces: list[tuple[list[int], bool, bool]] = []
    run: list[int] = []
    turned, starts_at_corner = 0.0, len(corners) > 0
    for number in range(count):
        edge = (first + number) % count
        corner = bool(turns[edge] >= SMOOTH_RAD)
        if run and (corner or turned + turns[edge] > PIECE_RAD):
            pieces.append((run, starts_at_corner, corner))
            run, turned, starts_at_corner = [], 0.0, corner
        elif run:
            turned += float(turns[edge])
        run.append(edge)
    pieces.append((run, starts_at_corner, len(corners) > 0))
    return pieces


def _spread(inner: Array, piece: tuple[list[int], bool, bool], samples: int) -> tuple[Array, Array]:
    """Evenly along a group: the edge that each profile lies on (S,), and how far along it (S,), 0 to 1."""
    edges, corner_before, corner_after = piece
    ends = np.roll(inner, -1, axis=0)
    lengths = np.linalg.norm(ends[edges] - inner[edges], axis=1)
    total = float(lengths.sum())
    skip = float(np.clip(SKIP_ENDS_M / total, SKIP_ENDS, MAX_SKIP_ENDS))
    half = 0.5 / samples
    at = total * np.linspace(skip if corner_before else half, 1.0 - (skip if corner_after else half), samples)
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    which = np.clip(np.searchsorted(starts, at, side="right") - 1, 0, len(edges) - 1)
    return np.array(edges)[which], (at - starts[which]) / lengths[which]


def _facing(outward: Array) -> Array:
    """(G,) int: groups that face the same way share a number."""
    numbers = np.full(len(outward), -1)
    for group in range(len(outward)):
        same = np.linalg.norm(outward[:group] - outward[group], axis=1) < SAME_DIRECTION
        numbers[group] = numbers[int(np.argmax(same))] if same.any() else numbers.max() + 1
    return numbers


@dataclass(frozen=True, slots=True, eq=False)
class SeenRim:
    """The rim at a pose in both pictures: outer points (2, G, S, 2), unit normals into the hole (2, G, S, 2), px, the
    chamfer's width along them (2, G, S), px, how far the outer and the inner point move along them per unit of
    (x, y, z, rx, ry, rz) of the pose (2, G, S, 6) each, per metre outward in the hole's plane (2, G, S), per metre into
    the hole (2, G, S), and how far apart the profiles are (2, G, S), px."""

    outer_px: Array
    normal: Array
    chamfer_px: Array
    outer_slope: Array
    inner_slope: Array
    outward_slope: Array
    depth_slope: Array
    spacing_px: Array


def perturbed(pose: Pose, step: Array) -> Pose:
    """The pose moved by (x, y, z, rx, ry, rz) in its own frame."""
    return pose @ Pose.from_rotvec(step[3:], step[:3])


def seen(rim: Rim, stereo: StereoModel, pose_camera_hole: Pose) -> SeenRim:
    """The rim at a pose, as both cameras see it."""
    points = np.stack([rim.outer_m, rim.inner_m])
    camera = pose_camera_hole.apply(points)
    probes = np.concatenate([camera[None], camera[None] + PROBE_M * np.eye(3)[:, None, None, None, :]])
    # (2, 4, outer and inner, G, S, 2)
    pixels = stereo.project(probes)
    centre = pixels[:, 0]
    rotation = pose_camera_hole.rotation
    # pixels per metre along the hole's own axes (2, 2, G, S, 2, 3)
    by_axis = np.moveaxis((pixels[:, 1:] - pixels[:, :1]) / PROBE_M, 1, -1) @ rotation
    along = np.einsum("kgsia,gsa->kgsi", by_axis[:, 0], rim.along)
    speed = np.linalg.norm(along, axis=-1)
    along = along / speed[..., None]
    normal = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    inward = -np.einsum("kgsia,gsa->kgsi", by_axis[:, 0], rim.outward)
    normal = normal * np.sign(np.sum(normal * inward, axis=-1, keepdims=True))
    # normal shift per metre along the hole's axes (2, outer and inner, G, S, 3)
    pull = np.einsum("kgsi,kogsia->kogsa", normal, by_axis)
    x, y, z = (points[..., axis] for axis in range(3))
    by_x, by_y, by_z = (pull[..., axis] for axis in range(3))
    # with the moment of each point, points x pull
    turns = [y * by_z - z * by_y, z * by_x - x * by_z, x * by_y - y * by_x]
    slopes = np.stack([by_x, by_y, by_z, *turns], axis=-1)
    if rim.round:
        # the facets of a round rim are the drawing's, not the hole's
        slopes[..., 5] = 0.0
    chamfer = np.sum((centre[:, 1] - centre[:, 0]) * normal, axis=-1)
    apart = np.linalg.norm(np.diff(rim.outer_m, axis=1), axis=-1)
    apart = np.concatenate([apart, apart[:, -1:]], axis=1)
    return SeenRim(
        centre[:, 0],
        normal,
        chamfer,
        slopes[:, 0],
        slopes[:, 1],
        np.einsum("kgsa,gsa->kgs", pull[:, 0], rim.outward),
        pull[:, 1, ..., 2],
        speed * apart,
    )
