"""The boxes of `crosspih bench domain`: one per level of a factor, with the result of its trials. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict
from rich.table import Table

from crosspih_common.errors import ConfigError
from services.operator.bench.cells.trials import TrialJob
from services.operator.bench.domain.factors import Factor
from services.operator.scoring.score import TrialFigures
from services.operator.scoring.statistics import BenchResult, summarise

WANTED = 0.95


class MapBox(BaseModel):
    """One box of the map. `result` is None when none of its trials was made."""

    model_config = ConfigDict(frozen=True)

    factor: str
    known: bool
    level: str
    is_default: bool
    result: BenchResult | None


class DomainResult(BaseModel):
    """What `crosspih bench domain --json` prints."""

    model_config = ConfigDict(frozen=True)

    strategy: str
    seed: int
    trials: int
    boxes: list[MapBox]


def chosen_factors(every: Sequence[Factor], wanted: Sequence[str]) -> list[Factor]:
    names = [factor.name for factor in every]
    for name in wanted:
        if name not in names:
            raise ConfigError(f"--factor {name}: no such factor; want one of {', '.join(names)}")
    return [factor for factor in every if not wanted or factor.name in wanted]


def boxes_of(chosen: Sequence[Factor], done: Sequence[tuple[TrialJob, TrialFigures]], seed: int) -> list[MapBox]:
    """The boxes of the map, in the factors' order, from trials in any order."""
    by_condition: dict[str, dict[int, TrialFigures]] = {}
    for job, figures in done:
        by_condition.setdefault(job.condition.name, {})[job.seed] = figures
    boxes = []
    for factor in chosen:
        for level in factor.levels:
            trials = by_condition.get(factor.condition(level).name, {})
            result = None
            if trials:
                each = [trials[seed] for seed in sorted(trials)]
                result = summarise(each[0].strategy, seed, each)
            boxes.append(
                MapBox(
                    factor=factor.name, known=factor.known, level=level.name, is_default=level.is_default, result=result
                )
            )
    return boxes


def table_of(result: DomainResult) -> Table:
    """A row per box."""
    table = Table(
        title=f"{result.strategy}: {result.trials} seeds a box, from {result.seed}, one factor at a time",
        caption="*: the services are not told; refused, felt for: by vision; found by force alone though it was asked",
    )
    table.add_column("factor", no_wrap=True)
    table.add_column("level", no_wrap=True)
    shown = ("in", "95 % Wilson", "refused, felt for", "touches p95", "F p95, N", "motion p50, s", "vision p50, mm")
    for name in shown:
        table.add_column(name, justify="right")
    table.add_column("failures")
    before = ""
    for box in result.boxes:
        first = box.factor != before
        if first and before:
            table.add_section()
        before = box.factor
        name = (box.factor + ("" if box.known else "*")) if first else ""
        level = box.level + (" (default)" if box.is_default else "")
        if box.result is None:
            table.add_row(name, level, "none")
            continue
        figures, found = box.result.figures, box.result
        vision = figures.get("vision_error_mm")
        table.add_row(
            name, level, f"{found.inserted}/{found.trials}", f"{found.wilson95_low:.0%}-{found.wilson95_high:.0%}",
            found.sight.short,
            f"{figures['touches'].p95:.1f}", f"{figures['peak_force_n'].p95:.1f}", f"{figures['motion_s'].p50:.1f}",
            "" if vision is None else f"{vision.p50:.2f}",
            ", ".join(f"{count} {failure}" for failure, count in found.failures.items()),
            style="" if found.success_rate >= WANTED else "red",
        )  # fmt: skip
    return table
