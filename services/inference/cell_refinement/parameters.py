"""The parameters to refine, their prior from the drawing's tolerances, and their effect on the shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.config import PegDrawing, Workcell
from crosspih_common.config.drawing import CROSS
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole, Peg

# joint fit: the taper's slope as a share, the hole's clearance, the F/T sensor's frame in the peg frame
GEOMETRY = ("taper", "clearance", "ft_x", "ft_y", "ft_z", "ft_rx", "ft_ry", "ft_rz")
# of the left camera in its own frame
CAMERA = ("camera_x", "camera_y", "camera_z", "camera_rx", "camera_ry", "camera_rz")
TAPER, CLEARANCE, SHIFT, TURN = 0, 1, slice(2, 5), slice(5, 8)
GEOMETRY_SD = np.array([0.01, 5e-5, *(5e-4,) * 3, *(np.deg2rad(0.5),) * 3])
CAMERA_SD = np.array([*(3e-3,) * 3, *(np.deg2rad(1.0),) * 3])
NAMES = GEOMETRY + CAMERA
PRIOR_SD = np.concatenate([GEOMETRY_SD, CAMERA_SD])
CAMERA_SHIFT, CAMERA_TURN = slice(8, 11), slice(11, 14)
MIN_CLEARANCE_M = 5e-6


@dataclass(frozen=True, slots=True)
class Refined:
    """One parameter in SI units: the cell file's value and the fitted one; `taken`: the data fix it to better than half
    of its tolerance, otherwise the old value stays. `value` goes into the cell's file."""

    name: str
    before: float
    found: float
    sd: float
    prior_sd: float
    taken: bool

    @property
    def value(self) -> float:
        """The value to use."""
        return self.found if self.taken else self.before


def refined_peg(drawing: PegDrawing, taper: float) -> dict[str, float]:
    """The settings of `cell.peg` for a taper steeper by a share; its start and the tip's plane stay."""
    factor, peg = 1.0 + taper, drawing.shape()
    if drawing.outline == CROSS and drawing.corners_m is None:
        slope = drawing.taper_slope * factor
        apex_m = peg.taper_start_m + (peg.apex_m - peg.taper_start_m) / factor
        return {"taper_slope": slope, "apex_m": apex_m, "tip_half_width_m": slope * (apex_m - peg.tip_m)}
    return {"tip_scale": 1.0 - (1.0 - float(peg.scale_at(peg.tip_m))) * factor}


def shapes(workcell: Workcell, taper: float, clearance_m: float) -> tuple[Peg, Hole]:
    """Peg and hole with the taper steeper by the share `taper` and the clearance larger by `clearance_m`."""
    drawing = workcell.peg
    if taper != 0.0:
        drawing = drawing.model_copy(update=refined_peg(drawing, taper))
    hole = workcell.hole.model_copy(
        update={"clearance_m": max(workcell.hole.clearance_m + clearance_m, MIN_CLEARANCE_M)}
    )
    # the hole follows the body, which the taper does not change
    return drawing.shape(), hole.shape(workcell.peg.shape())


def sensor_pose(parameters: Array) -> Pose:
    """The sensor's frame in the peg frame by the joint fit's parameters (14,)."""
    return Pose.from_rotvec(parameters[TURN], parameters[SHIFT])


def camera_pose(parameters: Array) -> Pose:
    """The left camera's pose in its calibrated frame, by the joint fit's parameters (14,)."""
    return Pose.from_rotvec(parameters[CAMERA_TURN], parameters[CAMERA_SHIFT])


def judged(
    names: tuple[str, ...], before: Array, found: Array, covariance: Array, prior_sd: Array, share: float = 0.5
) -> list[Refined]:
    """Decide which parameters the data fix: those whose sd is below `share` of the tolerance's.

    The others keep their old value, and the result is conditioned on that; its sd still includes their uncertainty.
    """
    sd = np.sqrt(np.diag(covariance))
    fixed = sd < share * prior_sd
    found = found.copy()
    held, free = np.flatnonzero(~fixed), np.flatnonzero(fixed)
    if len(held) and len(free):
        gain = covariance[np.ix_(free, held)] @ np.linalg.inv(covariance[np.ix_(held, held)])
        found[free] += gain @ (before[held] - found[held])
    return [
        Refined(name, float(before[i]), float(found[i]), float(sd[i]), float(prior_sd[i]), bool(fixed[i]))
        for i, name in enumerate(names)
    ]
