"""What touching is worth when vision is poor: run by hand, not a test.

    python -m tests.planning.measure_touching --scale 1 10 20 30 --force-alone --seeds 20

Whole assemblies in memory (real cell, real force/torque service, real estimator, played vision). `--scale` multiplies
the played vision's standard deviations (`VISION_SD`); `--force-alone` stands for no vision at all: 3 mm and 0.05 rad on
every axis. One line a trial with `--each`, then one table. The covariance that vision states is the true one.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import (
    EstimatePose,
    EstimateSeated,
    HoleEstimate,
    LocateHole,
    PoseData,
    PoseErrorEstimate,
    floats,
)
from services.inference.config import InferenceConfig
from services.inference.shell.service import InferenceShell
from services.operator.scoring.score import PoseError, pose_error
from tests.planning.cell_in_memory import VISION_SD, CellInMemory

FORCE_ALONE_SD = np.array([3e-3, 3e-3, 3e-3, 0.05, 0.05, 0.05])


class ListeningInference(InferenceShell):
    """The service as it is, with a memory of what it answered."""

    def __init__(self, *arguments: Any) -> None:
        self.seated: PoseErrorEstimate | None = None
        self.estimates: list[tuple[EstimatePose, PoseErrorEstimate]] = []
        super().__init__(*arguments)

    def _estimate(self, request: EstimatePose) -> PoseErrorEstimate:
        answer = super()._estimate(request)
        self.estimates.append((request, answer))
        return answer

    def _seated(self, request: EstimateSeated) -> PoseErrorEstimate:
        self.seated = super()._seated(request)
        return self.seated


class PoorlySeenCell(CellInMemory):
    """A cell whose vision errs by `vision_sd` (6,), hole frame, m and rad."""

    def __init__(self, folder: Path) -> None:
        self.vision_sd: Array = VISION_SD
        super().__init__(folder, with_inference=False)
        self.inference = ListeningInference(self.context("inference"), InferenceConfig())
        self._shells.append(self.inference)

    def _locate(self, request: LocateHole) -> HoleEstimate:
        if self.vision_scale is None:
            raise CommandRefused("no_cross", "left: no dark region has the shape of the hole")
        error = np.random.default_rng(self.truth().seed).normal(size=6) * self.vision_sd
        return HoleEstimate(
            pose_base_hole=PoseData.of(
                self.truth().pose_base_hole.pose() @ Pose.from_rotvec(error[3:], error[:3]),
            ),
            covariance=floats(np.diag(self.vision_sd**2)),
            method=request.method,
            orientation_measured=True,
            capture_id=1,
            capture_wall_s=0.0,
        )


@dataclass(frozen=True)
class Trial:
    """One assembly. nees: squared error of T2 without its depth over its covariance, five degrees of freedom."""

    seed: int
    inserted: bool
    failure: str
    detail: str
    touches: int
    corrections: int
    peak_force_n: float
    peak_moment_nm: float
    motion_s: float
    presses_used: int
    seat: PoseError | None
    final: PoseError | None
    nees: float
    seat_nees: float
    compute_s: list[float] = field(default_factory=list)
    phases: tuple[str, ...] = ()


def nees(estimate: PoseErrorEstimate, true_base_hole: Pose) -> float:
    """Normalised squared error in x, y and the three rotations."""
    between = estimate.pose_base_hole.pose().inverse() @ true_base_hole
    error = np.concatenate([between.translation_m, between.rotvec_rad()])
    keep = np.array([0, 1, 3, 4, 5])
    covariance = np.asarray(estimate.covariance).reshape(6, 6)[np.ix_(keep, keep)]
    return float(error[keep] @ np.linalg.solve(covariance, error[keep]))


def trial(cell: PoorlySeenCell, seed: int) -> Trial:
    """One assembly of a seed with the cell's present vision."""
    cell.reset(seed)
    inference = cell.inference
    inference.seated, inference.estimates = None, []
    result = cell.assemble()
    truth = cell.truth().pose_base_hole.pose()
    seated = inference.seated
    pressed = [answer for request, answer in inference.estimates if request.touches[0].seated]
    final = result.pose_base_hole.pose() if result.inserted and result.pose_base_hole else None
    answer = pressed[-1] if pressed and any(use.used for use in pressed[-1].rests_on) else seated
    return Trial(
        seed,
        result.inserted,
        result.failure.value if result.failure else "",
        result.failure_detail,
        result.touches,
        result.corrections,
        result.peak_force_n,
        result.peak_moment_nm,
        result.motion_s,
        sum(use.used for answer in pressed for use in answer.rests_on),
        pose_error(seated.pose_base_hole.pose(), truth) if seated else None,
        pose_error(final, truth) if final else None,
        nees(answer, truth) if final and answer else float("nan"),
        nees(seated, truth) if final and seated else float("nan"),
        [answer.compute_s for _, answer in inference.estimates],
        tuple(f"{phase.phase.value}: {phase.text}" for phase in cell.phases),
    )


def spread(values: list[float], digits: int) -> str:
    """p50/p95."""
    if not values:
        return "-"
    return "/".join(f"{np.percentile(values, share):.{digits}f}" for share in (50, 95))


def row(name: str, trials: list[Trial]) -> str:
    """One line of the table."""
    final = [t.final for t in trials if t.final]
    failures = Counter(t.failure for t in trials if not t.inserted)
    columns = [
        name,
        f"{sum(t.inserted for t in trials)} of {len(trials)}",
        spread([t.touches for t in trials], 0),
        spread([t.corrections for t in trials], 0),
        spread([t.peak_force_n for t in trials], 0),
        spread([t.motion_s for t in trials], 1),
        spread([error.lateral_mm for error in final], 3),
        spread([error.rotation_deg for error in final], 2),
        spread([second for t in trials for second in t.compute_s], 2),
        ", ".join(f"{count} {failure}" for failure, count in failures.items()) or "-",
    ]
    return "| " + " | ".join(columns) + " |"


def seat_row(name: str, trials: list[Trial]) -> str:
    """What the presses against the bore add to the seat."""
    done = [t for t in trials if t.final and t.seat]
    seat, final = [t.seat for t in done if t.seat], [t.final for t in done if t.final]
    columns = [
        name,
        spread([error.lateral_mm for error in seat], 3),
        spread([error.rotation_deg for error in seat], 2),
        spread([t.seat_nees for t in done], 1),
        spread([error.lateral_mm for error in final], 3),
        spread([error.rotation_deg for error in final], 2),
        spread([t.nees for t in done], 1),
        str(dict(sorted(Counter(t.presses_used for t in done).items()))),
    ]
    return "| " + " | ".join(columns) + " |"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scale", type=float, nargs="*", default=[])
    parser.add_argument("--force-alone", action="store_true")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--each", action="store_true", help="a line a trial")
    parser.add_argument(
        "--phases", action="store_true", help="the phases of trials that failed or needed over 2 touches"
    )
    options = parser.parse_args()
    cases = [(f"vision x {scale:g}", VISION_SD * scale) for scale in options.scale]
    if options.force_alone:
        cases.append(("force alone", FORCE_ALONE_SD))
    tables, seats = [], []
    with tempfile.TemporaryDirectory() as folder:
        cell = PoorlySeenCell(Path(folder))
        try:
            cell.reset(0)
            cell.assemble()  # calibrates
            for name, sd in cases:
                cell.vision_sd = sd
                trials = []
                started = time.perf_counter()
                for seed in range(options.first, options.first + options.seeds):
                    done = trial(cell, seed)
                    trials.append(done)
                    if options.each:
                        final = (
                            f"{done.final.lateral_mm:.3f} mm {done.final.rotation_deg:.2f} deg" if done.final else ""
                        )
                        seat = f"{done.seat.lateral_mm:.3f} mm {done.seat.rotation_deg:.2f} deg" if done.seat else ""
                        print(
                            f"{name} seed {seed}: {done.failure or 'inserted'} {done.detail}; {done.touches} touches, "
                            f"{done.corrections} corrections, {done.peak_force_n:.0f} N, {done.peak_moment_nm:.1f} Nm, "
                            f"{done.motion_s:.1f} s; seat {seat}; final {final}; presses used {done.presses_used}, "
                            f"nees {done.nees:.1f}; compute {max(done.compute_s, default=0.0):.2f} s",
                            flush=True,
                        )
                    if options.phases and (not done.inserted or done.touches > 2):
                        print("    " + "\n    ".join(done.phases), flush=True)
                print(f"{name}: {time.perf_counter() - started:.0f} s", flush=True)
                tables.append(row(name, trials))
                seats.append(seat_row(name, trials))
        finally:
            cell.close()
    print(
        "\n| case | inserted | touches | corrections | peak force N | motion s | final mm | final deg | estimate s "
        "| failures |"
    )
    print("\n".join(tables))
    print("\n| case | seat mm | seat deg | NEES (5) | pressed mm | pressed deg | NEES (5) | presses used: trials |")
    print("\n".join(seats))


if __name__ == "__main__":
    main()
