"""A contact of the tip with the face of the plate: how to know it, and the plane that several of them make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.planning.search.outline_field import inside_m

# A face pushes along its normal, within the tilt and the friction cone; walls and chamfers push across.
FACE_LEAN_RAD = 0.35
# The line of action meets the tip's own plane inside the tip, give or take the noise of a 5 N reading.
BESIDE_TIP_M = 1.0e-3
FACE_SD_M = 2.0e-4


@dataclass(frozen=True, slots=True, eq=False)
class FaceContact:
    """Where the tip touched: `point_m` (3,) in the nominal hole's frame, and whether a corner of the tip did it.

    Where no corner did, a rim of the hole pressed into the tip, and the point lies on the rim.
    """

    point_m: Array
    at_corner: bool


def face_contact(
    tip_m: Array, pose_nominal_peg: Pose, wrench: Array, corner_reach_m: float = 1.0e-3
) -> FaceContact | None:
    """What a touch says if it was the face that the tip met; None where it was something else.

    tip_m: the tip's outline (n, 3) in the peg frame; pose_nominal_peg: where the peg truly is (deflection included) in
    the nominal hole's frame; wrench (6,): on the peg, peg frame. A single contact's force acts along one line
    (M = r x F); a face's force lies near the peg's axis and its line meets the tip's plane within the tip.
    """
    force, moment = np.asarray(wrench, float)[:3], np.asarray(wrench, float)[3:]
    size = float(np.linalg.norm(force))
    if size < 1.0 or -force[2] < np.cos(FACE_LEAN_RAD) * size:
        return None
    nearest_to_origin = np.cross(force, moment) / size**2
    height = float(tip_m[0, 2])
    point = nearest_to_origin + force * (height - nearest_to_origin[2]) / force[2]
    if float(inside_m(tip_m[:, :2], point[None, :2])[0]) < -BESIDE_TIP_M:
        return None
    to_corners = np.linalg.norm(tip_m[:, :2] - point[:2], axis=1)
    at_corner = bool(to_corners.min() < corner_reach_m)
    if at_corner:
        point = tip_m[int(to_corners.argmin())]
    return FaceContact(pose_nominal_peg.apply(point), at_corner)


@dataclass(frozen=True, slots=True, eq=False)
class FacePlane:
    """The face as z = a + b x + c y in the nominal hole's frame: mean (3,) of (a, b, c) in m and 1, covariance."""

    mean: Array
    covariance: Array

    @classmethod
    def from_half_ranges(cls, half_ranges: Array) -> FacePlane:
        """What is known before any touch; half_ranges (6,): x, y, z in m, rx, ry, rz in rad, uniform."""
        sd = np.array([half_ranges[2], half_ranges[4], half_ranges[3]]) / np.sqrt(3.0)
        return cls(np.zeros(3), np.diag(sd**2))

    @staticmethod
    def _row(point_m: Array) -> Array:
        return np.array([1.0, point_m[0], point_m[1]])

    def depth_m(self, point_m: Array) -> tuple[float, float]:
        """How far a point (3,) lies behind the face, m, and the standard deviation of that."""
        row = self._row(point_m)
        return float(point_m[2] - row @ self.mean), float(np.sqrt(row @ self.covariance @ row))

    def with_point(self, point_m: Array, sd_m: float = FACE_SD_M) -> FacePlane:
        """The plane after a point (3,) on it (Kalman update)."""
        row = self._row(point_m)
        gain = self.covariance @ row / (row @ self.covariance @ row + sd_m**2)
        covariance = self.covariance - np.outer(gain, row @ self.covariance)
        return FacePlane(self.mean + gain * float(point_m[2] - row @ self.mean), 0.5 * (covariance + covariance.T))

    @property
    def tilt_rad(self) -> tuple[float, float]:
        """(rx, ry) that turn the nominal hole's z axis onto the plane's normal, to the first order."""
        return float(self.mean[2]), float(-self.mean[1])

    def pose(self, x_m: float, y_m: float, turn_rad: float = 0.0) -> Pose:
        """A frame on the face at (x, y) of the nominal hole's frame, z along the normal, turned about it."""
        z_m = float(self._row(np.array([x_m, y_m])) @ self.mean)
        return Pose.from_rotvec([*self.tilt_rad, turn_rad], [x_m, y_m, z_m])


def face_plane(half_ranges: Array, contacts: Sequence[FaceContact]) -> FacePlane:
    """The plane through all contacts."""
    plane = FacePlane.from_half_ranges(half_ranges)
    for contact in contacts:
        plane = plane.with_point(contact.point_m)
    return plane
