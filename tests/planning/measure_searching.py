"""What force alone is worth: run by hand, not a test.

    python -m tests.planning.measure_searching --lateral-mm 5 10 --seeds 20 --phases

Whole assemblies in memory (real cell, real force/torque service, real estimator), vision refusing. The hole is drawn
from the cell's own prior, whose lateral half range is `--lateral-mm`.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from crosspih_common.config.drawing import PegDrawing
from crosspih_common.messages import AssemblyResult, Strategy
from services.operator.scoring.score import pose_error
from tests.planning.cell_in_memory import CellInMemory


def spread(values: list[float], digits: int = 1) -> str:
    """p50/p95/max."""
    if not values:
        return "-"
    return "/".join(f"{np.percentile(values, share):.{digits}f}" for share in (50, 95, 100))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lateral-mm", type=float, nargs="*", default=[5.0, 10.0])
    parser.add_argument("--strategy", type=Strategy, default=Strategy.FORCE_ALONE)
    parser.add_argument("--peg", default="cross", help="an outline by name")
    parser.add_argument("--seeds", type=int, nargs="*", default=None, help="these, instead of --first and --count")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--phases", action="store_true", help="the phases of trials that failed")
    parser.add_argument("--all-phases", action="store_true", help="the phases of every trial")
    options = parser.parse_args()
    seeds = options.seeds or list(range(options.first, options.first + options.count))
    for lateral_mm in options.lateral_mm:
        with tempfile.TemporaryDirectory() as folder:
            cell = CellInMemory(
                Path(folder), half_range_lateral_m=lateral_mm * 1e-3, peg=PegDrawing(outline=options.peg)
            )
            cell.vision_scale = None
            try:
                cell.reset(0)
                cell.assemble(options.strategy)  # calibrates
                started = time.perf_counter()
                done: list[AssemblyResult] = []
                finals = []
                for seed in seeds:
                    cell.reset(seed)
                    result = cell.assemble(options.strategy)
                    done.append(result)
                    truth = cell.truth().pose_base_hole.pose()
                    off = cell.cell.workcell.hole_prior.pose_base_hole().inverse() @ truth
                    final = ""
                    if result.inserted and result.pose_base_hole is not None:
                        error = pose_error(result.pose_base_hole.pose(), truth)
                        finals.append(error)
                        final = f"final {error.lateral_mm:.3f} mm {error.rotation_deg:.2f} deg"
                    x, y, z = off.translation_m * 1e3
                    a, b, c = off.rotvec_rad()
                    print(
                        f"seed {seed} ({x:+.1f} {y:+.1f} {z:+.1f} mm, {a:+.3f} {b:+.3f} {c:+.3f}): "
                        f"{result.failure.value if result.failure else 'in'} {result.failure_detail} "
                        f"{result.touches} touches {result.corrections} corrections {result.pushes} pushes "
                        f"{result.peak_force_n:.0f} N {result.peak_moment_nm:.1f} Nm {result.motion_s:.1f} s "
                        f"{result.thinking_s:.1f} s {final}",
                        flush=True,
                    )
                    if options.all_phases or (options.phases and not result.inserted):
                        for phase in cell.phases:
                            figures = " ".join(f"{name} {value:.3g}" for name, value in phase.figures.items())
                            print(f"      {phase.phase.value}: {phase.text}  {figures}", flush=True)
            finally:
                cell.close()
        inserted = [result for result in done if result.inserted]
        failures = Counter(result.failure.value for result in done if result.failure)
        print(
            f"+-{lateral_mm:g} mm: {len(inserted)} of {len(done)} inserted {dict(failures)}; p50/p95/max: "
            f"touches {spread([r.touches for r in done], 0)}, corrections {spread([r.corrections for r in done], 0)}, "
            f"force {spread([r.peak_force_n for r in done])} N, "
            f"moment {spread([r.peak_moment_nm for r in done], 2)} Nm, "
            f"motion {spread([r.motion_s for r in done])} s, thinking {spread([r.thinking_s for r in done])} s, "
            f"final {spread([e.lateral_mm for e in finals], 3)} mm {spread([e.rotation_deg for e in finals], 3)} deg; "
            f"{time.perf_counter() - started:.0f} s of computing",
            flush=True,
        )


if __name__ == "__main__":
    main()
