"""Strategies side by side, from their trials. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict

from services.operator.bench.cells.conditions import Condition
from services.operator.bench.cells.own_code_of import SETTINGS
from services.operator.bench.cells.trials import TrialJob
from services.operator.scoring.score import TrialFigures
from services.operator.scoring.statistics import BenchResult, summarise

OF_INSERTED = ("duration_s", "motion_s", "final_error_mm", "final_error_deg")


class ComparedStrategy(BaseModel):
    """A strategy under a condition. `all` is over every trial, `inserted` over those that inserted, if any."""

    model_config = ConfigDict(frozen=True)

    condition: str
    strategy: str
    all: BenchResult
    inserted: BenchResult | None
    mean_score: float | None


class Comparison(BaseModel):
    """What `crosspih bench compare --json` prints."""

    model_config = ConfigDict(frozen=True)

    seed: int
    conditions: list[Condition]
    rows: list[ComparedStrategy]

    def of(self, condition: str) -> list[ComparedStrategy]:
        """The rows of a condition, in the order of their first trials."""
        return [row for row in self.rows if row.condition == condition]


def compare_strategies(seed: int, done: Sequence[tuple[TrialJob, TrialFigures]]) -> Comparison:
    """One row for each condition and strategy among the trials."""
    conditions: dict[str, Condition] = {}
    groups: dict[tuple[str, str], list[TrialFigures]] = {}
    for job, figures in done:
        conditions.setdefault(job.condition.name, job.condition)
        groups.setdefault((job.condition.name, row_name(job)), []).append(figures)
    return Comparison(
        seed=seed,
        conditions=list(conditions.values()),
        rows=[_row(seed, condition, strategy, trials) for (condition, strategy), trials in groups.items()],
    )


def row_name(job: TrialJob) -> str:
    """The strategy, and the name of somebody's own code that it uses."""
    inference = job.condition.overrides.get("inference", {})
    own = [str(inference[setting]) for setting in SETTINGS if inference.get(setting)]
    return " with ".join([job.strategy.value, *own])


def _row(seed: int, condition: str, strategy: str, trials: list[TrialFigures]) -> ComparedStrategy:
    inserted = [trial for trial in trials if trial.inserted]
    scores = [trial.challenge_score for trial in trials if trial.challenge_score is not None]
    return ComparedStrategy(
        condition=condition,
        strategy=strategy,
        all=summarise(strategy, seed, trials),
        # their trials are already in `all`
        inserted=summarise(strategy, seed, inserted).model_copy(update={"each": []}) if inserted else None,
        mean_score=float(np.mean(scores)) if scores else None,
    )
