"""Checks a calibration against the cell's drawing of the peg: the load must end where the peg's tip is."""

from __future__ import annotations

import numpy as np

from crosspih_common.shapes import Peg
from crosspih_common.wrench import Payload

BEYOND_TIP_M = 0.02
BESIDE_M = 0.06
BEHIND_M = 0.25


def judge_centroid(payload: Payload, peg: Peg) -> str | None:
    """The reason why the centroid cannot belong to a tool with this peg; None if it can."""
    x, y, z = (float(value) for value in payload.mounting.pose_peg_sensor.apply(payload.centroid_sensor_m))
    beside, widest = float(np.hypot(x, y)), peg.outline.radius_m
    tip_mm = peg.tip_m * 1e3
    mend = (
        "see cell.force_torque.moment_unit, where the sensor is (cell.force_torque.pose_flange_sensor), and whether "
        "the peg of cell.peg is mounted"
    )
    if z > peg.tip_m + BEYOND_TIP_M:
        return (
            f"centroid: {z * 1e3:.0f} mm ahead of the peg's frame, while by its drawing the peg ends at {tip_mm:.0f} "
            f"mm; {mend}"
        )
    if z < -BEHIND_M or beside > widest + BESIDE_M:
        return (
            f"centroid: ({x * 1e3:.0f}, {y * 1e3:.0f}, {z * 1e3:.0f}) mm in the peg's frame, while by its drawing the "
            f"peg reaches {widest * 1e3:.0f} mm from its axis and to {tip_mm:.0f} mm along it; {mend}"
        )
    return None
