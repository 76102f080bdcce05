"""Checks the recording against itself: what was counted in two places must be the same number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.messages import AssemblyResult
from services.operator.report.model.forces import Forces
from services.operator.report.model.motion import AnsweredMotion
from services.operator.report.numbers import Quantity

# tolerance between two computations of one force: the arm uses the orientation of its cycle, a report that of the
# encoder sample
NEAR_N, NEAR_NM, NEAR_SHARE = 0.3, 0.03, 0.02
NEAR_S = 0.1


@dataclass(frozen=True, slots=True)
class Check:
    """One number found in two ways, each in words; `agrees` says whether they are equal within the named tolerance."""

    what: str
    one: Quantity
    one_is: str
    other: Quantity
    other_is: str
    agrees: bool


def checks_of(
    result: AssemblyResult | None,
    touches: int,
    presses: int,
    forces: Forces,
    motions: list[AnsweredMotion],
    true_depth_mm: float | None,
) -> list[Check]:
    """The checks that this recording allows; without a result there are none.

    `touches` and `presses` are the numbers of recorded ones, `true_depth_mm` is the peg's true depth, where that is
    known.
    """
    if result is None:
        return []
    checks = [
        _count("touches", result.touches, touches),
        _count("presses", result.presses, presses),
    ]
    unfiltered = forces.unfiltered
    if unfiltered is not None:
        in_motion = np.zeros(len(unfiltered.time_s), dtype=bool)
        for motion in motions:
            in_motion |= (unfiltered.time_s >= motion.start_s) & (unfiltered.time_s <= motion.end_s)
        if in_motion.any():
            pairs = (
                ("largest |F| of any motion, in free air or not", result.peak_force_n, unfiltered.force_n, "N", NEAR_N),
                ("largest |M| of any motion, in free air or not", result.peak_moment_nm, unfiltered.moment_nm, "Nm",
                 NEAR_NM),
            )  # fmt: skip
            for what, arms, samples, unit, near in pairs:
                ours = float(samples[in_motion].max())
                checks.append(
                    Check(
                        what, Quantity(arms, unit), "as the arm's control felt it, in the result",
                        Quantity(ours, unit), "of the sensor's samples, reckoned here",
                        abs(ours - arms) <= near + NEAR_SHARE * arms,
                    )
                )  # fmt: skip
    moved_s = sum(motion.end_s - motion.start_s for motion in motions)
    checks.append(
        Check(
            "time in motions", Quantity(result.motion_s, "s"), "as planning added it up",
            Quantity(moved_s, "s"), f"of the {len(motions)} motions that were answered",
            abs(moved_s - result.motion_s) <= NEAR_S,
        )
    )  # fmt: skip
    if result.inserted and true_depth_mm is not None:
        truly = true_depth_mm
        own = result.insertion_depth_m * 1e3
        checks.append(
            Check(
                "insertion depth", Quantity(own, "mm", 1), "by the hole as found (T2) and the encoders",
                Quantity(truly, "mm", 1), "by the simulator's truth",
                truly is not None and abs(truly - own) <= 0.5,
            )
        )  # fmt: skip
    return checks


def _count(what: str, said: int, seen: int) -> Check:
    return Check(
        what, Quantity(said, "", 0), "as planning counted them", Quantity(seen, "", 0), "told on the bus",
        said == seen,
    )  # fmt: skip
