"""`python -m services.inference.estimator`: coverage of the 95 % region over simulated trials."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from scipy.stats import chi2

from crosspih_common.config import Workcell, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.provenance import ResultStore, code_version, result_key, with_file_contents
from services.inference.estimator.coverage import BLOCKS, CoverageRow, TouchRecord, TrialSettings, run_trial, summary
from services.inference.estimator.observation import EstimatorSettings
from services.inference.mechanics import PairTables
from services.inference.touch_choice.by_information import candidates, informed_touch
from services.inference.touch_choice.by_rule import next_touch

# one sd: x, y, z (m), rx, ry, rz (rad)
PRIORS = {
    "vision": (2e-4, 2e-4, 6e-4, 0.01, 0.01, 0.002),
    "poor": (1e-3, 1e-3, 2e-3, 0.04, 0.04, 0.01),
    "wide": (5.8e-3, 5.8e-3, 8.7e-3, 0.058, 0.058, 0.058),
    "force": (3e-3, 3e-3, 3e-3, 0.05, 0.05, 0.05),
}


def table(rows: list[CoverageRow]) -> str:
    """The rows as Markdown."""
    lines = [
        "| touches | trials | " + " | ".join(f"{name}: held % (95 % int.)" for name in BLOCKS) + " | NEES p50/p95 "
        + "| lateral mm p50/p95 | rotation deg p50/p95 | several contacts | used |"
    ]  # fmt: skip
    lines.append("|" + "---|" * (len(BLOCKS) + 7))
    for row in rows:
        held = [f"{share * 100:.1f} ({low * 100:.1f}-{high * 100:.1f})" for share, low, high in row.covered.values()]
        nees = ", ".join(f"{p50:.1f}/{p95:.1f}" for p50, p95 in row.nees_p50_p95.values())
        lines.append(
            f"| {row.touches} | {row.trials} | {' | '.join(held)} | {nees} | {row.lateral_mm[0]:.3f}/"
            f"{row.lateral_mm[1]:.3f} | {row.rotation_deg[0]:.2f}/{row.rotation_deg[1]:.2f} "
            f"| {row.several_contacts * 100:.0f} % | {row.used * 100:.1f} % |"
        )
    ideal = [(chi2.ppf(0.5, len(keep)), chi2.ppf(0.95, len(keep))) for keep in BLOCKS.values()]
    lines.append("NEES of an honest one: " + ", ".join(f"{p50:.1f}/{p95:.1f}" for p50, p95 in ideal))
    return "\n".join(lines)


def trials(
    make: Callable[[int], list[TouchRecord]], seeds: range, made_with: dict[str, Any], out: Path | None
) -> dict[int, list[TouchRecord]]:
    """The trials of all seeds by seed. Trials in the file `out` are reused if they were made with the same settings,
    cell and code (`made_with`, plain data); new ones are appended to it.
    """
    console = Console(stderr=True)
    if out is None:
        return {seed: make(seed) for seed in track(seeds, "trials", console=console)}
    code = code_version()
    done: dict[int, list[TouchRecord]] = {}
    with ResultStore(out, "--out") as store:
        keys = {seed: result_key({**made_with, "seed": seed, "code": code}) for seed in seeds}
        for seed, key in keys.items():
            if (kept := store.get(key)) is not None:
                done[seed] = [TouchRecord(**record) for record in kept["records"]]
        if said := store.reuse_summary(code):
            console.print(said, highlight=False)
        for seed in track([seed for seed in seeds if seed not in done], "trials", console=console):
            started = time.monotonic()
            done[seed] = make(seed)
            records = [dataclasses.asdict(record) for record in done[seed]]
            took_s = round(time.monotonic() - started, 3)
            store.put(keys[seed], {"records": records}, code=code, took_s=took_s, seed=seed)
    return done


def main() -> None:
    """Simulate trials, estimate, and count how often the truth lies in the region."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="of the first trial; one more for each")
    parser.add_argument("--touches", type=int, default=4)
    parser.add_argument("--prior", choices=sorted(PRIORS), default="poor")
    parser.add_argument("--policy", choices=("pattern", "information"), default="pattern", help="of the next touch")
    parser.add_argument("--most-contacts", type=int, default=4, help="that one touch may be explained by")
    parser.add_argument("--cell", type=Path, help="a cell's file, for its peg and hole; without: the default cell")
    parser.add_argument("--out", type=Path, help="keeps each trial (JSON lines), so that a stopped run goes on")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    workcell = load_cell(arguments.cell).workcell if arguments.cell else Workcell()
    peg = workcell.peg.shape()
    tables = PairTables.of(peg, workcell.hole.shape(peg))
    estimator = EstimatorSettings(friction_mean=workcell.friction_expected, contacts=arguments.most_contacts)

    compliance = workcell.compliance_peg(np.asarray(workcell.home_joints_rad))

    def informed(belief: Pose, covariance: Array, made: int, used: bool) -> tuple[Pose, Array]:
        plans = candidates(peg, belief, covariance)
        plan, _ = informed_touch(
            tables, plans, belief, covariance, compliance, workcell.friction_expected, np.random.default_rng(made)
        )
        return plan.pose_base_peg_start, plan.direction_base

    def pattern(belief: Pose, covariance: Array, made: int, used: bool) -> tuple[Pose, Array]:
        plan = next_touch(peg, belief, covariance, made, made, last_touch_used=used)
        return plan.pose_base_peg_start, plan.direction_base

    settings = TrialSettings(PRIORS[arguments.prior], arguments.touches)
    policy = informed if arguments.policy == "information" else pattern
    nominal = workcell.hole_prior.pose_base_hole()
    seeds = range(arguments.seed, arguments.seed + arguments.trials)
    # settings holds the prior's numbers and how the touches are made; a policy's name identifies its code
    made_with = {
        "coverage": dataclasses.asdict(settings),
        "estimator": dataclasses.asdict(estimator),
        "policy": arguments.policy,
        "cell": with_file_contents(workcell.model_dump(mode="json", exclude={"name"})),
    }
    try:
        done = trials(
            lambda seed: list(run_trial(tables, nominal, compliance, policy, estimator, settings, seed)),
            seeds, made_with, arguments.out,
        )  # fmt: skip
    except ConfigError as error:
        print(error, file=sys.stderr)
        sys.exit(1)
    records = [record for seed in seeds for record in done[seed]]
    rows = summary(records)
    if arguments.json:
        print(json.dumps({"prior": arguments.prior, "rows": [dataclasses.asdict(row) for row in rows]}, indent=2))
    else:
        print(table(rows))


if __name__ == "__main__":
    main()
