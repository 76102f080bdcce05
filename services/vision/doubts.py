"""Converts the cell file's tolerances of hole and calibration into the doubts that the fit uses."""

from __future__ import annotations

from math import hypot

from crosspih_common.config import HoleTolerance
from services.vision.config import CalibrationDoubt
from services.vision.fit.solve import Doubts


def doubts_of(tolerance: HoleTolerance, calibration: CalibrationDoubt) -> Doubts:
    """A broken edge can move either line of the chamfer; a chamfer that is too wide moves the outer one."""
    return Doubts(
        outer_sd_m=hypot(tolerance.edge_break_m, tolerance.chamfer_m),
        inner_sd_m=tolerance.edge_break_m,
        size_sd_m=tolerance.size_m,
        offset_sd_px=calibration.offset_sd_px,
        k1_sd=calibration.k1_sd,
        k1_untold_sd=calibration.k1_untold_sd,
    )
