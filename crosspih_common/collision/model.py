"""Distances between the moving parts of the cell and its obstacles, at one posture and along a path.

The rule
--------
Every part of the arm keeps the distance `cell.surroundings.margin_m` from all obstacles, keep-out boxes and the floor.
The tool and the peg also keep it from the links before the wrist. There are two exceptions.

- The base (link 1) stands on the floor.
- A working motion (`working`) may bring the peg, the tool and the last link, which are rigidly connected, to the
  fixture and its stand while the peg is at work: its tip is in the cylinder about the nominal hole in which the hole
  may be, not behind the plate, and its axis is within 0.5 rad of the hole's (`Fixture.at_work`). The other links keep
  clear of the fixture also then. No other obstacle is excepted, in particular no keep-out box.

The fixture is placed by the prior of the hole and enlarged so that it covers the plate wherever the hole may be.

An arm that is already nearer to something than the margin may move, but not nearer to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crosspih_common.collision.fixture import Fixture
from crosspih_common.collision.moving import moving_parts, reaches_m
from crosspih_common.collision.shapes import library, obstacles_of, shape_of
from crosspih_common.config import Workcell
from crosspih_common.config.surroundings import FIXTURE, FLOOR, STAND
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array

WRIST = 3  # the links from the wrist on are not checked against the tool they carry
BEFORE_ZONE_M = 1e-3  # beyond the margin, for the arm's own inaccuracy
NO_NEARER_M = 5e-4  # how much nearer an arm that stands too near may still come, by rounding and settling


@dataclass(frozen=True, slots=True)
class Clearance:
    """The least distance at a posture, m (negative: the depth of overlap), and the two parts."""

    distance_m: float
    moving: str
    obstacle: str


@dataclass(frozen=True, slots=True)
class Violation:
    """The first posture of a path that is too near to something: before knot `index`, at `joints_rad` (n,)."""

    index: int
    joints_rad: tuple[float, ...]
    moving: str
    obstacle: str
    distance_m: float
    wanted_m: float

    def __str__(self) -> str:
        gap = self.distance_m * 1e3
        how = f"come within {gap:.0f} mm of" if gap > 0.0 else f"be {-gap:.0f} mm inside"
        return (
            f"{self.moving} would {how} {self.obstacle} (want {self.wanted_m * 1e3:.0f} mm): go another way, or "
            "correct cell.surroundings or cell.hole_prior"
        )


class _Pair(NamedTuple):
    """A moving part and the obstacle, or other moving part, that it is checked against, each by its index."""

    part: int
    other: int
    stands: bool
    excepted: bool  # while the peg is at work
    distance: Any


class CollisionModel:
    """The parts and obstacles of one cell. Use it from one thread at a time: the library caches its last guess.

    Raises ConfigError when a mesh cannot be read or the library is not installed.
    """

    def __init__(self, workcell: Workcell) -> None:
        coal = library()
        self._coal, self._request = coal, coal.DistanceRequest()
        self._arm = workcell.arm()
        self._joints = self._arm.joints
        self._peg_corners_m = np.vstack([piece.vertices_m() for piece in workcell.peg.shape().pieces()])
        self._tip_m = workcell.peg.shape().tip_m
        self.margin_m = workcell.surroundings.margin_m
        self.fixture = Fixture.of(workcell)
        self._parts = moving_parts(workcell)
        self._reaches_m = reaches_m(workcell, self._parts)
        self._frames = [part.frame for part in self._parts]
        self._pose_part_peg = self._parts[-1].pose_frame_part.inverse() @ workcell.pose_flange_peg()
        self._part_rotations = np.array([part.pose_frame_part.rotation for part in self._parts])
        self._part_places_m = np.array([part.pose_frame_part.translation_m for part in self._parts])
        self._bounds_m = np.array([part.bound_m for part in self._parts])
        self._obstacles = obstacles_of(workcell, self.fixture)
        self._box_rotations = np.array([one.pose_base_box.rotation for one in self._obstacles])
        self._box_places_m = np.array([one.pose_base_box.translation_m for one in self._obstacles])
        self._half_boxes_m = np.array([one.half_box_m for one in self._obstacles])
        self._stands = [self._transform(one.pose_base.rotation, one.pose_base.translation_m) for one in self._obstacles]
        self._shapes = [shape_of(part) for part in self._parts]  # the library points at them and does not keep them
        self._pairs = self._paired()
        self._excepted = np.array([pair.excepted for pair in self._pairs])
        self._standing_part, self._standing_other = _indices([pair for pair in self._pairs if pair.stands])
        self._moving_part, self._moving_other = _indices([pair for pair in self._pairs if not pair.stands])
        self._of_fixture = coal.ComputeDistance(self._shapes[-1], self._obstacles[0].shape)

    def _paired(self) -> list[_Pair]:
        distance, shapes, last = self._coal.ComputeDistance, self._shapes, self._joints
        pairs = []
        for index, part in enumerate(self._parts):
            for other, obstacle in enumerate(self._obstacles):
                if obstacle.name == FLOOR and index == 0:
                    continue
                excepted = obstacle.name in (FIXTURE, STAND) and part.frame == last
                pairs.append(_Pair(index, other, True, excepted, distance(shapes[index], obstacle.shape)))
        for index in (last, last + 1):  # the tool and the peg
            for other in range(last - WRIST):
                pairs.append(_Pair(index, other, False, False, distance(shapes[index], shapes[other])))
        return pairs

    # ------------------------------------------------------------------------------------------------------- asking

    @property
    def obstacles(self) -> tuple[str, ...]:
        """The names of the obstacles."""
        return tuple(one.name for one in self._obstacles)

    def postures(self, joints_rad: ArrayLike) -> int:
        """The largest number of postures that `check_path` checks on a path through knots (k, n), rad."""
        return len(self._dense(np.asarray(joints_rad, float))[0])

    def clearance(self, joints_rad: ArrayLike, *, working: bool = False) -> Clearance:
        """The least distance at joints (n,), rad, and between what. `working`: see the rule above."""
        rotations, places = self._placed(np.asarray(joints_rad, float)[None])
        bounds = self._lower_bounds_m(rotations, places)[0]
        if working and self._at_work(rotations[0], places[0]):
            bounds[self._excepted] = np.inf
        best, found = np.inf, self._pairs[0]
        standing: dict[int, Any] = {}
        for index in np.argsort(bounds).tolist():
            if bounds[index] >= best:
                break
            gap = self._exact_m(self._pairs[index], rotations[0], places[0], standing)
            if gap < best:
                best, found = gap, self._pairs[index]
        return Clearance(float(best), self._parts[found.part].name, self._name_of(found))

    def distances_m(self, joints_rad: ArrayLike) -> dict[tuple[str, str], float]:
        """All checked distances at joints (n,), rad, by part and obstacle, m; slower than `clearance`."""
        rotations, places = self._placed(np.asarray(joints_rad, float)[None])
        standing: dict[int, Any] = {}
        return {
            (self._parts[pair.part].name, self._name_of(pair)): self._exact_m(pair, rotations[0], places[0], standing)
            for pair in self._pairs
        }

    def check_path(self, joints_rad: ArrayLike, *, working: bool = False) -> Violation | None:
        """The first place where straight joint moves through knots (k, n), rad, come too near; None when they do not.

        The postures between the knots are so close that no point moves farther than the margin from one to the next.
        Between them every part therefore keeps at least half the margin. `working`: see the rule above; use False for a
        free move. A path that is curved between its knots needs more knots.
        """
        joints, knots = self._dense(np.asarray(joints_rad, float))
        rotations, places = self._placed(joints)
        bounds = self._lower_bounds_m(rotations, places)
        wanted = np.full(len(self._pairs), self.margin_m)
        for row in np.flatnonzero((bounds < self.margin_m).any(axis=1)).tolist():
            near = np.flatnonzero(bounds[row] < wanted)
            if working and self._excepted[near].any() and self._at_work(rotations[row], places[row]):
                near = near[~self._excepted[near]]
            standing: dict[int, Any] = {}
            gaps = {i: self._exact_m(self._pairs[i], rotations[row], places[row], standing) for i in near.tolist()}
            short = {index: gap for index, gap in gaps.items() if gap < wanted[index]}
            if row == 0:
                for index, gap in short.items():
                    wanted[index] = gap - NO_NEARER_M
            elif short:
                worst = min(short, key=lambda index: short[index])
                pair = self._pairs[worst]
                return Violation(
                    index=int(knots[row]),
                    joints_rad=tuple(joints[row].tolist()),
                    moving=self._parts[pair.part].name,
                    obstacle=self._name_of(pair),
                    distance_m=short[worst],
                    wanted_m=self.margin_m,
                )
        return None

    def tip_clearance_m(self, pose_base_peg: Pose) -> float:
        """How far the peg is from the fixture's zone, m; negative inside it. For a limit on the speed near it."""
        pose = pose_base_peg @ self._pose_part_peg.inverse()
        peg = self._transform(pose.rotation, pose.translation_m)
        return float(self._of_fixture(peg, self._stands[0], self._request, self._coal.DistanceResult()))

    def before_zone(self, pose_base_peg: Pose) -> Pose:
        """The pose, moved back along the peg's axis until the whole peg is clear in front of the zone.

        A free move can start from there. Unchanged if the peg is not at work.
        """
        if not self.fixture.at_work(pose_base_peg, self._tip_m):
            return pose_base_peg
        corners_m = pose_base_peg.apply(self._peg_corners_m)
        short_m = self.margin_m + BEFORE_ZONE_M - self.fixture.before_m(corners_m)
        along = float(pose_base_peg.rotation[:, 2] @ self.fixture.pose_base_hole.rotation[:, 2])
        return pose_base_peg @ Pose.from_translation([0.0, 0.0, -max(short_m, 0.0) / along])

    # ------------------------------------------------------------------------------------------------------ reckoning

    def _dense(self, knots: Array) -> tuple[Array, NDArray[np.int64]]:
        """Postures (m, n) on the path through knots (k, n), and the next knot of each."""
        if knots.ndim != 2 or knots.shape[1] != self._joints or not len(knots):
            raise ValueError(f"joints_rad wants shape (k, {self._joints}) with k >= 1, got {knots.shape}")
        steps = np.diff(knots, axis=0)
        pieces = np.maximum(1, np.ceil(np.abs(steps) @ self._reaches_m / self.margin_m).astype(np.int64))
        which = np.repeat(np.arange(len(steps)), pieces)
        share = (np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 1) / pieces[which]
        between = knots[which] + share[:, None] * steps[which]
        return np.concatenate([knots[:1], between]), np.concatenate([[0], which + 1])

    def _placed(self, joints: Array) -> tuple[Array, Array]:
        """Rotations (k, p, 3, 3) and centres (k, p, 3) of the parts in the base frame."""
        frames = [self._arm.frames(row) for row in joints]
        rotations = np.array([frame[0] for frame in frames])[:, self._frames]
        places = np.array([frame[1] for frame in frames])[:, self._frames]
        return rotations @ self._part_rotations, places + (rotations @ self._part_places_m[..., None])[..., 0]

    def _lower_bounds_m(self, rotations: Array, places: Array) -> Array:
        """(k, pairs): lower bounds of the distances, m, from balls around parts and boxes around obstacles."""
        away = places[:, :, None] - self._box_places_m
        beyond = np.abs(np.einsum("oji,kpoj->kpoi", self._box_rotations, away)) - self._half_boxes_m
        outside = np.maximum(beyond, 0.0)
        standing = np.sqrt(np.einsum("kpoi,kpoi->kpo", outside, outside)) + np.minimum(beyond.max(axis=3), 0.0)
        standing -= self._bounds_m[:, None]
        bounds = standing[:, self._standing_part, self._standing_other]
        apart = places[:, self._moving_part] - places[:, self._moving_other]
        reach = self._bounds_m[self._moving_part] + self._bounds_m[self._moving_other]
        return np.concatenate([bounds, np.sqrt(np.einsum("kpi,kpi->kp", apart, apart)) - reach], axis=1)

    def _exact_m(self, pair: _Pair, rotations: Array, places: Array, transforms: dict[int, Any]) -> float:
        """The distance of a pair at one posture; `transforms` keeps the parts' of that posture."""
        here = self._transform_of(pair.part, rotations, places, transforms)
        there = (
            self._stands[pair.other] if pair.stands else self._transform_of(pair.other, rotations, places, transforms)
        )
        return float(pair.distance(here, there, self._request, self._coal.DistanceResult()))

    def _transform_of(self, part: int, rotations: Array, places: Array, transforms: dict[int, Any]) -> Any:
        if part not in transforms:
            transforms[part] = self._transform(rotations[part], places[part])
        return transforms[part]

    def _transform(self, rotation: Array, place_m: Array) -> Any:
        return self._coal.Transform3s(rotation, place_m)

    def _at_work(self, rotations: Array, places: Array) -> bool:
        return self.fixture.at_work(Pose(rotations[-1], places[-1]) @ self._pose_part_peg, self._tip_m)

    def _name_of(self, pair: _Pair) -> str:
        return self._obstacles[pair.other].name if pair.stands else self._parts[pair.other].name


def _indices(pairs: list[_Pair]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    return np.array([pair.part for pair in pairs], np.int64), np.array([pair.other for pair in pairs], np.int64)
