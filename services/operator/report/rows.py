"""The tables of a report, row by row. Numbers are `Quantity`s of the facts, so that a tile and a row show the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from services.operator.report.model import Facts
from services.operator.report.model.forces import Peak
from services.operator.report.model.touches import TouchEntry
from services.operator.report.numbers import Quantity, number
from services.operator.scoring.score import PoseError, pose_error


@dataclass(frozen=True, slots=True)
class PeakRow:
    """The largest force and moment of some samples, the name of these samples, and the times."""

    name: str
    of: str
    force: Quantity
    force_at: Quantity
    moment: Quantity
    moment_at: Quantity


def peak_rows(facts: Facts) -> list[PeakRow]:
    """Every peak in the report, with the samples that it is of."""
    forces, rows = facts.forces, []

    def row(name: str, of: str, peak: Peak | None) -> None:
        if peak is not None:
            rows.append(
                PeakRow(
                    name, of, Quantity(peak.force_n, "N"), Quantity(peak.force_at_s, "s"),
                    Quantity(peak.moment_nm, "Nm"), Quantity(peak.moment_at_s, "s"),
                )
            )  # fmt: skip

    if forces.unfiltered is not None:
        rate = forces.unfiltered.rate_hz
        row("contact, unfiltered", f"every sample of the sensor, {rate:.0f} Hz", forces.contact_unfiltered)
    if forces.filtered is not None:
        row("contact, filtered", f"force_torque/wrench, {forces.filtered.rate_hz:.0f} Hz", forces.contact_filtered)
    explained = ""
    if forces.unexplained_n is not None:
        explained = f"; all but {number(forces.unexplained_n)} N is mass times acceleration of the tool"
    row("free air", f"no contact is possible{explained}", forces.inertia)
    return rows


@dataclass(frozen=True, slots=True)
class PoseRow:
    """One line of the pose table: cells of the columns, in their order."""

    name: str
    cells: tuple[Quantity, ...]


def pose_rows(facts: Facts) -> list[PoseRow]:
    """The seen, the found and the true pose of the hole; with a truth also the error of each."""
    poses = facts.poses
    rows = [
        PoseRow(f"{axis} / mm", tuple(Quantity(float(each.pose.translation_m[index]) * 1e3) for each in poses))
        for index, axis in enumerate("xyz")
    ]
    if not any(each.error is not None for each in poses):
        return rows
    whole = (
        ("off across the hole's axis / mm", "lateral_mm", 3),
        ("off in depth, along its axis / mm", "depth_mm", 3),
        ("turned in all / °", "rotation_deg", 2),
        ("tilt of the axis / °", "tilt_deg", 2),
    )
    for name, field, digits in whole:
        off = [None if each.error is None else getattr(each.error, field) for each in poses]
        rows.append(PoseRow(name, tuple(Quantity(value, "", digits) for value in off)))
    names = [f"off along the hole's {axis} / mm" for axis in "xyz"]
    names += [f"turned about the hole's {axis} / °" for axis in "xyz"]
    for index, name in enumerate(names):
        if index != 2:  # along z is the depth
            along = [None if each.off is None else each.off[index] for each in poses]
            rows.append(PoseRow(name, tuple(Quantity(value, "", 3) for value in along)))
    return rows


def matrix_text(pose: Pose) -> str:
    """A 4 x 4 pose as the paper prints it."""
    rows = ["  ".join(f"{value:+.4f}".replace("-", "−").replace("+", " ") for value in row) for row in pose.matrix()]
    return "\n".join(rows)


@dataclass(frozen=True, slots=True)
class TouchRow:
    """One touch in words and numbers."""

    number: str
    time_s: str
    wrench: tuple[str, ...]
    force: str
    state: str
    confidence: str
    reason: str
    angles: str
    offset: str
    rank: str
    friction: str
    error: str
    use: str


def touch_row(entry: TouchEntry, true_hole: Pose | None, symmetry_order: int = 4) -> TouchRow:
    """A touch, the estimate made after it, and the error of that estimate against the truth."""
    state, estimate, use = entry.touch.state, entry.estimate, entry.use
    off: PoseError | None = None
    if estimate is not None and true_hole is not None:
        off = pose_error(estimate.pose_base_hole.pose(), true_hole, symmetry_order)
    seated = entry.touch.seated
    return TouchRow(
        number=f"p{entry.number}" if seated else str(entry.number),
        time_s=number(entry.time_s),
        wrench=(
            *(number(value, 2) for value in entry.touch.wrench[:3]),
            *(number(value, 3) for value in entry.touch.wrench[3:]),
        ),
        force=number(float(np.linalg.norm(entry.touch.wrench[:3])), 2),
        state="a wall of the bore" if seated else state.case or "none of the 26",
        confidence="" if seated else f"{state.confidence * 100:.0f} %",
        reason="" if seated else state.reason,
        angles="–" if estimate is None else ", ".join(number(float(np.rad2deg(a))) for a in estimate.angles_rad),
        offset="–" if estimate is None else ", ".join(number(value * 1e3) for value in estimate.translation_m),
        rank="–" if estimate is None else f"{estimate.rank} of 6",
        friction="–" if estimate is None else f"{number(estimate.friction)} ± {number(estimate.friction_sd)}",
        error="–" if off is None else f"{number(off.lateral_mm, 3)} mm, {number(off.rotation_deg)}°",
        use="–"
        if use is None
        else f"{use.hypothesis}, {number(use.residual_sigma, 1)} σ" + ("" if use.used else " (set aside)"),
    )
