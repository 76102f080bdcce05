"""A comparison as a table for people."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.table import Table

from services.operator.bench.compare.comparison import ComparedStrategy, Comparison
from services.operator.scoring.statistics import BenchResult

SCORE_CAPTION = (
    "refused, felt for: vision refused; the hole was found by force alone though it was asked. "
    "p50, or p50/p95. time (motion and thinking) and final error: of the inserted; all else: of all trials. "
    "mean and peak: |F| in contact. score: mean points of 100 as in the AI for Industry Challenge, adapted: "
    "inserted 75, time 12 (5 s) to 0 (60 s), smoothness 6 (mean jerk 0) to 0 (50 m/s³), way of the tip 6 "
    "(straight) to 0 (1 m more), valid 1, -12 for more than 1 s above 20 N; nothing for being near"
)


COLUMNS = (
    "inserted", "95 %\nWilson", "time s", "refused,\nfelt for", "touches", "mean N", "peak N", "final\nmm", "final\n°",
    "score",
)  # fmt: skip


def compare_table(comparison: Comparison, condition: str) -> Table:
    """The rows of one condition."""
    rows = comparison.of(condition)
    trials = max(row.all.trials for row in rows)
    table = Table(
        title=f"{condition}, seeds {comparison.seed} to {comparison.seed + trials - 1}",
        caption=SCORE_CAPTION,
        box=SIMPLE_HEAD,
        padding=(0, 1),
    )
    table.add_column("strategy", no_wrap=True)
    for name in COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("failures")
    for row in rows:
        table.add_row(*_cells(row))
    return table


def _cells(row: ComparedStrategy) -> list[str]:
    whole, inserted = row.all, row.inserted
    often = sorted(whole.failures.items(), key=lambda one: -one[1])
    failures = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in often)
    return [
        row.strategy,
        f"{whole.inserted}/{whole.trials}",
        f"{whole.wilson95_low:.0%}-{whole.wilson95_high:.0%}",
        _spread(inserted, "duration_s", 1),
        whole.sight.short,
        _spread(whole, "touches", 0),
        _median(whole, "mean_force_n", 1),
        _spread(whole, "peak_force_n", 0),
        _median(inserted, "final_error_mm", 3),
        _median(inserted, "final_error_deg", 2),
        "-" if row.mean_score is None else f"{row.mean_score:.1f}",
        failures or "-",
    ]


def _spread(result: BenchResult | None, name: str, digits: int) -> str:
    value = None if result is None else result.figures.get(name)
    return "-" if value is None else f"{value.p50:.{digits}f}/{value.p95:.{digits}f}"


def _median(result: BenchResult | None, name: str, digits: int) -> str:
    value = None if result is None else result.figures.get(name)
    return "-" if value is None else f"{value.p50:.{digits}f}"
