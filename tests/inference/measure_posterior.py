"""The posterior in the whole simulated cell: run by hand, not a test.

    python -m tests.inference.measure_posterior --trials 50 --scale 20 --out posterior.jsonl

Whole assemblies in memory with poor played vision (`--scale` times its standard deviations; `--force-alone`: 3 mm and
0.05 rad on every axis). Every answer of the estimator, and of the seat and the presses, is held against the truth: how
often the 95 % region holds it, and the quantiles of the squared error over the covariance. A stopped run goes on from
its file, which keeps every request too.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from scipy.stats import chi2

from crosspih_common.geometry import Pose
from crosspih_common.messages import PoseErrorEstimate
from crosspih_common.provenance import ResultStore, code_version, result_key
from services.inference.estimator.coverage import BLOCKS
from tests.planning.cell_in_memory import VISION_SD
from tests.planning.measure_touching import FORCE_ALONE_SD, PoorlySeenCell


def judged(answer: PoseErrorEstimate, truth: Pose) -> dict[str, float]:
    """Squared error over covariance of each block."""
    between = answer.pose_base_hole.pose().inverse() @ truth
    off = np.concatenate([between.translation_m, between.rotvec_rad()])
    covariance = np.asarray(answer.covariance).reshape(6, 6)
    return {
        name: float(off[keep] @ np.linalg.solve(covariance[np.ix_(keep, keep)], off[keep]))
        for name, keep in BLOCKS.items()
    }


def trial(cell: PoorlySeenCell, seed: int) -> list[dict[str, Any]]:
    """One assembly: a line for each answer."""
    cell.reset(seed)
    inference = cell.inference
    inference.seated, inference.estimates = None, []
    result = cell.assemble()
    seated: PoseErrorEstimate | None = inference.seated
    truth = cell.truth().pose_base_hole.pose()
    lines: list[dict[str, Any]] = []
    for request, answer in inference.estimates:
        kind = "pressed" if request.touches[0].seated else f"{len(request.touches)} touches"
        lines.append(
            {
                "kind": kind,
                "nees": judged(answer, truth),
                "used": [use.used for use in answer.rests_on],
                "request": request.model_dump(mode="json"),
            }
        )
    if seated is not None:
        lines.append({"kind": "seated", "nees": judged(seated, truth)})
    truth_matrix = truth.matrix().tolist()
    return [{"seed": seed, "inserted": result.inserted, "truth": truth_matrix, **line} for line in lines]


def table(lines: list[dict[str, Any]]) -> str:
    """A row for each kind of answer."""
    rows = ["| answer | n | " + " | ".join(f"{name}: held, NEES p50/p95" for name in BLOCKS) + " |"]
    rows.append("|" + "---|" * (len(BLOCKS) + 2))
    for kind in sorted({line["kind"] for line in lines}):
        these = [line["nees"] for line in lines if line["kind"] == kind]
        columns = []
        for name, keep in BLOCKS.items():
            values = np.array([nees[name] for nees in these])
            held = np.mean(values <= chi2.ppf(0.95, len(keep)))
            columns.append(f"{held * 100:.0f} %, {np.percentile(values, 50):.1f}/{np.percentile(values, 95):.1f}")
        rows.append(f"| {kind} | {len(these)} | {' | '.join(columns)} |")
    return "\n".join(rows)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--seed", type=int, default=100, help="of the first trial")
    parser.add_argument("--scale", type=float, default=20.0)
    parser.add_argument("--force-alone", action="store_true")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    kept: list[dict[str, Any]] = []
    code = code_version("tests.inference.measure_posterior", "tests.planning")
    made_with = {"code": code, "scale": options.scale, "force_alone": options.force_alone}
    store = ResultStore(options.out, "--out") if options.out else None
    with tempfile.TemporaryDirectory() as folder:
        cell = PoorlySeenCell(Path(folder))
        try:
            cell.reset(0)
            cell.assemble()  # calibrates
            cell.vision_sd = FORCE_ALONE_SD if options.force_alone else VISION_SD * options.scale
            seeds = range(options.seed, options.seed + options.trials)
            for seed in track(seeds, "trials", console=Console(stderr=True)):
                key = result_key({**made_with, "seed": seed})
                found = None if store is None else store.get(key)
                lines = trial(cell, seed) if found is None else found["lines"]
                kept += lines
                if store is not None and found is None:
                    store.put(key, {"lines": lines}, code=code)
            if store is not None:
                print(store.reuse_summary(code), file=sys.stderr)
        finally:
            cell.close()
    print(table(kept))


if __name__ == "__main__":
    main()
