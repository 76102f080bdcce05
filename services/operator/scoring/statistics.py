"""Statistics of trials: counts with Wilson intervals, p50 and p95. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict

from services.operator.scoring.score import SWITCHED_OFF, TrialFigures

FIGURES = (
    "duration_s",
    "motion_s",
    "thinking_s",
    "wall_s",
    "touches",
    "corrections",
    "pushes",
    "peak_force_n",
    "peak_moment_nm",
    "mean_force_n",
    "over_20_n_s",
    "tip_path_m",
    "mean_jerk_m_s3",
    "challenge_score",
    "vision_error_mm",
    "vision_error_deg",
    "vision_tilt_deg",
    "final_error_mm",
    "final_error_deg",
    "insertion_depth_mm",
)

# a peg that was withdrawn again is as far away as its arm: that is not a depth
OF_INSERTED = ("insertion_depth_mm",)


class Quantiles(BaseModel):
    """The quantiles of a figure over the trials that have it."""

    model_config = ConfigDict(frozen=True)

    count: int
    p50: float
    p95: float
    max: float


class Sight(BaseModel):
    """The part of vision in the trials. refused: by code; a cell's file with vision disabled gives `switched_off`,
    where no picture was taken. felt_for: trials that found the hole by force alone though vision was asked, and how
    many of these inserted. untouched: trials that inserted without a touch.
    """

    model_config = ConfigDict(frozen=True)

    looked: int
    refused: dict[str, int]
    felt_for: int
    felt_for_inserted: int
    untouched: int

    @property
    def short(self) -> str:
        """For a narrow column: trials in which vision looked and refused, and trials that found the hole by force
        alone.
        """
        looks = sum(count for code, count in self.refused.items() if code != SWITCHED_OFF)
        return f"{looks}, {self.felt_for}"


class _Looked(Protocol):
    """The fields about vision in a trial of any bench."""

    @property
    def looked(self) -> bool: ...
    @property
    def vision_refused(self) -> str: ...
    @property
    def felt_for(self) -> bool: ...


def sight_row(trials: Sequence[_Looked]) -> tuple[str, str]:
    """A row of a table: how many looked, were refused, and went on by force."""
    looked, felt_for = sum(one.looked for one in trials), sum(one.felt_for for one in trials)
    refused = sum(one.vision_refused not in ("", SWITCHED_OFF) for one in trials)
    return "vision looked, refused, found by force instead", f"{looked}, {refused}, {felt_for}"


def sight_of(trials: Sequence[TrialFigures]) -> Sight:
    """How many looked, were refused, and went on by force."""
    felt = [trial for trial in trials if trial.felt_for]
    return Sight(
        looked=sum(trial.looked for trial in trials),
        refused=dict(Counter(trial.vision_refused for trial in trials if trial.vision_refused)),
        felt_for=len(felt),
        felt_for_inserted=sum(trial.inserted for trial in felt),
        untouched=sum(trial.inserted and trial.touches == 0 for trial in trials),
    )


class BenchResult(BaseModel):
    """What `crosspih bench assembly --json` prints."""

    model_config = ConfigDict(frozen=True)

    strategy: str
    seed: int
    trials: int
    inserted: int
    success_rate: float
    wilson95_low: float
    wilson95_high: float
    failures: dict[str, int]
    backed_off_of_failed: int
    sight: Sight
    figures: dict[str, Quantiles]
    each: list[TrialFigures]


def wilson95(successes: int, trials: int) -> tuple[float, float]:
    """The Wilson score interval at 95 %."""
    from scipy.stats import binomtest  # takes half a second to load: not at the start of every command

    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def summarise(strategy: str, seed: int, trials: Sequence[TrialFigures]) -> BenchResult:
    """Counts, interval, quantiles and failures by name. ValueError without trials."""
    if not trials:
        raise ValueError("no trials to summarise")
    inserted = sum(trial.inserted for trial in trials)
    low, high = wilson95(inserted, len(trials))
    figures: dict[str, Quantiles] = {}
    for name in FIGURES:
        counted = [trial for trial in trials if trial.inserted or name not in OF_INSERTED]
        values = np.array([value for trial in counted if (value := getattr(trial, name)) is not None], dtype=float)
        if len(values):
            p50, p95 = np.percentile(np.abs(values), [50.0, 95.0])
            figures[name] = Quantiles(
                count=len(values), p50=float(p50), p95=float(p95), max=float(np.max(np.abs(values)))
            )
    failed = [trial for trial in trials if not trial.inserted]
    return BenchResult(
        strategy=strategy,
        seed=seed,
        trials=len(trials),
        inserted=inserted,
        success_rate=inserted / len(trials),
        wilson95_low=low,
        wilson95_high=high,
        failures=dict(Counter(trial.failure or "unknown" for trial in failed)),
        backed_off_of_failed=sum(trial.backed_off for trial in failed),
        sight=sight_of(trials),
        figures=figures,
        each=list(trials),
    )
