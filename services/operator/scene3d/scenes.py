"""The two pictures of an assembly: the arm in its cell, and a close view of peg and hole with the plate cut open."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.operator.scene3d.bodies import Bodies, cut_normal, shadow, where_peg_is
from services.operator.scene3d.meshes import Colour, joined
from services.operator.scene3d.rasterising import Picture, Viewpoint, draw

LIGHT = np.array([-0.15, -0.55, 0.85])
BACKGROUND: Colour = (0.90, 0.92, 0.945)
FORCE = (200, 22, 40)
ARROW_M_N = 0.0025  # metres of an arrow per newton
SHORTEST_ARROW_M, LONGEST_ARROW_M = 0.012, 0.06
MIN_ARROW_N = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """The state at one moment: the joints (n,), rad, and the load on the peg (6,), peg frame, about its origin. The arm
    is drawn deflected by that load.
    """

    joints_rad: Array
    wrench: Array | None = None


def overview(bodies: Bodies, hole: Pose, moment: Moment, size: tuple[int, int]) -> Picture:
    """The whole arm before the plate."""
    peg = bodies.peg.at(where_peg_is(bodies.workcell, moment.joints_rad))
    solid = joined([bodies.arm(moment.joints_rad), peg, bodies.plate.at(hole), bodies.post(hole)])
    return draw(joined([bodies.floor(), shadow(solid, LIGHT), solid]), whole_view(hole), size, BACKGROUND, LIGHT)


def whole_view(hole: Pose) -> Viewpoint:
    """From the side of the hole, so that arm and plate are both in the picture."""
    target = 0.5 * hole.translation_m + np.array([0.02, 0.0, 0.13])
    along = hole.translation_m * np.array([1.0, 1.0, 0.0])
    along = along / np.linalg.norm(along)
    aside = np.array([along[1], -along[0], 0.0])
    eye = target + 1.25 * (0.93 * aside - 0.06 * along) + np.array([0.0, 0.0, 0.34])
    return Viewpoint(tuple(eye), tuple(target), angle_deg=36.0)


def closeup(bodies: Bodies, hole: Pose, moment: Moment, size: tuple[int, int]) -> Picture:
    """Peg and hole with half of the plate removed; on top the force on the peg as an arrow that ends at its tip."""
    workcell = bodies.workcell
    pose, view = where_peg_is(workcell, moment.joints_rad, moment.wrench), near_view(bodies, hole)
    picture = draw(joined([bodies.plate_cut.at(hole), bodies.peg.at(pose)]), view, size, BACKGROUND, LIGHT)
    if moment.wrench is not None:
        force = np.asarray(moment.wrench[:3])
        felt_n = float(np.linalg.norm(force))
        if felt_n > MIN_ARROW_N:
            way = pose.rotate(force) / felt_n * min(LONGEST_ARROW_M, SHORTEST_ARROW_M + felt_n * ARROW_M_N)
            tip = pose.apply([0.0, 0.0, workcell.peg.shape().tip_m])
            _arrow(picture, *view.pixels(np.stack([tip - way, tip]), size))
    return picture


def _arrow(picture: Picture, start: Array, end: Array) -> None:
    """Drawn over the picture: the peg's tip, where the arrow ends, is often hidden in the hole."""
    (x, y), (to_x, to_y) = (np.round(point).astype(int).tolist() for point in (start, end))
    length = max(1.0, float(np.hypot(to_x - x, to_y - y)))
    for colour, thickness in (((255, 255, 255), 6), (FORCE, 3)):
        cv2.arrowedLine(
            picture, (x, y), (to_x, to_y), colour, thickness, cv2.LINE_AA, tipLength=min(0.5, 13.0 / length)
        )


def near_view(bodies: Bodies, hole: Pose) -> Viewpoint:
    """On the open side of the plate, the peg coming from one side of the picture."""
    normal = cut_normal(bodies.workcell)
    axis = np.array([0.0, 0.0, 1.0])
    side = np.cross(axis, normal)
    far = hole.apply(0.29 * (0.72 * normal + 0.62 * side - 0.30 * axis))
    if far[1] > hole.translation_m[1]:
        far = hole.apply(0.29 * (0.72 * normal - 0.62 * side - 0.30 * axis))
    target = hole.apply([0.0, 0.0, -0.006])
    return Viewpoint(tuple(far), tuple(target), angle_deg=27.0)
