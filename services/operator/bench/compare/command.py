"""`crosspih bench compare`: every strategy on the same seeds and cells, with vision as it is, worse, and off."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.messages import OwnStrategy, Strategy
from crosspih_common.messages.assembly import AnyStrategy
from services.operator.bench.cells.conditions import Condition
from services.operator.bench.cells.pool import ExecutorName
from services.operator.bench.cells.progress import CellsProgress
from services.operator.bench.cells.trials import DEFAULT_STORE, TrialJob
from services.operator.bench.compare.comparison import Comparison, compare_strategies
from services.operator.bench.compare.figure import check_suffix, save_figure
from services.operator.bench.compare.table import compare_table
from services.operator.bench.options import AsJson, Cells, RayAddress, Store, Where, errors_shown, run_kept
from services.operator.cli.chosen_strategy import chosen

POOR = {"lateral_m": 0.0025, "depth_m": 0.002, "rotation_rad": 0.0524}
POORLY = f"off by {POOR['lateral_m'] * 1e3:g} mm and {math.degrees(POOR['rotation_rad']):.0f}° an axis"


class Vision(str, Enum):
    """How well the cameras work."""

    GOOD = "good"  # unchanged
    POOR = "poor"  # every pose found has a normal error with POOR's standard deviations, and reports these
    OFF = "off"  # nothing is seen: only the cell's drawing is known


CONDITIONS = {
    Vision.GOOD: Condition(name="good vision"),
    Vision.POOR: Condition(name=f"poor vision: {POORLY}", overrides={"vision": {"extra_noise": POOR}}),
    Vision.OFF: Condition(name="no vision", overrides={"vision": {"enabled": False}}),
}
# in the order of the table: from no information to full
STRATEGIES = (
    Strategy.STRAIGHT,
    Strategy.VISION_ONLY,
    Strategy.ADMITTANCE,
    Strategy.SPIRAL,
    Strategy.TILT,
    Strategy.PAPER,
    Strategy.NETWORK_SPIRAL,
    Strategy.SEQUENCE,
    Strategy.FUSED,
)


# strategies that may use somebody's own code; a strategy of somebody's own may use both
ASKS = {
    "estimator": (Strategy.FUSED, Strategy.FORCE_ALONE),
    "network": (Strategy.PAPER, Strategy.NETWORK_SPIRAL),
}


def compare(
    trials: Annotated[int, typer.Option(min=1, help="How many seeds, the same for every strategy.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1000,
    vision: Annotated[
        list[Vision] | None,
        typer.Option(help=f"good: as it is; poor: {POORLY}; off. May be repeated; all if left out."),
    ] = None,
    strategy: Annotated[
        list[str] | None,
        typer.Option(
            help="Only this one, or one of your own, module:Class; may be repeated; all that are compared if left out."
        ),
    ] = None,
    estimator: Annotated[
        list[str] | None,
        typer.Option(help="One of your own, module:function: fused and force_alone with it too, a row each."),
    ] = None,
    network: Annotated[
        list[str] | None,
        typer.Option(help="One of your own, module:function: paper and network_spiral with it too, a row each."),
    ] = None,
    picture: Annotated[Path, typer.Option(help="Where the figure goes: .png, .svg or .pdf.")] = Path(
        "results/compare.png"
    ),
    cells: Cells = None,
    executor: Where = ExecutorName.LOCAL,
    ray_address: RayAddress = None,
    store: Store = DEFAULT_STORE,
    as_json: AsJson = False,
) -> None:
    """Every strategy on the same seeds: success, time, touches, forces, errors, failures, and a score."""
    console = Console(stderr=True)
    with errors_shown(console):
        check_suffix(picture)
        jobs = [
            TrialJob(seed=seed + index, strategy=one, condition=condition)
            for seeing in vision or list(Vision)
            for index in range(trials)
            for one, condition in _rows(
                [chosen(name) for name in strategy] if strategy else STRATEGIES,
                CONDITIONS[seeing],
                {"estimator": estimator or [], "network": network or []},
            )
        ]
        # failures are many here and meant to be: they stand in the table, not above the bar
        done, ended = run_kept(jobs, CellsProgress(console, "compare"), cells, executor, ray_address, store)
        if done:
            comparison = compare_strategies(seed, done)
            _show(comparison, as_json)
            save_figure(comparison, picture)
        if ended is not None:
            raise ended


def _rows(
    strategies: Sequence[AnyStrategy], condition: Condition, own: Mapping[str, Sequence[str]]
) -> list[tuple[AnyStrategy, Condition]]:
    """Each strategy, and after it the same with each estimator or network of somebody's own that it can use."""
    found = []
    for one in strategies:
        found.append((one, condition))
        for setting, names in own.items():
            if one in ASKS[setting] or isinstance(one, OwnStrategy):
                found += [(one, _with(condition, setting, name)) for name in names]
    return found


def _with(condition: Condition, setting: str, name: str) -> Condition:
    return condition.model_copy(update={"overrides": {**condition.overrides, "inference": {setting: name}}})


def _show(comparison: Comparison, as_json: bool) -> None:
    if as_json:
        sys.stdout.write(comparison.model_dump_json(indent=1) + "\n")
        return
    out = Console()
    for condition in comparison.conditions:
        out.print(compare_table(comparison, condition.name))
