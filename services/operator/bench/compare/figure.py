"""A comparison as a picture: success with its interval, time, peak force and score, one colour per condition."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crosspih_common.errors import ConfigError
from services.operator.bench.compare.comparison import ComparedStrategy, Comparison
from services.operator.scoring.score import TrialFigures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#3b6ea5", "#d08a2e", "#8a8a8a", "#4f8f5b", "#a14d6e")
SUFFIXES = (".png", ".svg", ".pdf")
TICKS_S = (5.0, 10.0, 20.0, 50.0, 100.0)
BAND = 0.8  # share of a row's height


def check_suffix(path: Path) -> None:
    """Raises ConfigError for a file name without a known picture format."""
    if path.suffix.lower() not in SUFFIXES:
        raise ConfigError(f"--picture {path}: want a name that ends in {', '.join(SUFFIXES)}")


def save_figure(comparison: Comparison, path: Path) -> None:
    """Draw and save. Raises ConfigError as `check_suffix`."""
    check_suffix(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    draw(comparison).savefig(path, dpi=150)


def draw(comparison: Comparison) -> Figure:
    """Four panels that share the strategies."""
    # imported here: only a command that draws waits for it
    from matplotlib.figure import Figure

    strategies = list(dict.fromkeys(row.strategy for row in comparison.rows))
    figure = Figure(figsize=(13.0, 1.9 + 0.52 * len(strategies)), layout="constrained")
    success, time_s, force_n, score = figure.subplots(1, 4, sharey=True)
    names = [condition.name for condition in comparison.conditions]
    for index, name in enumerate(names):
        colour = COLOURS[index % len(COLOURS)]
        height = BAND / len(names)
        shift = (index - 0.5 * (len(names) - 1)) * height
        for row in comparison.of(name):
            y = strategies.index(row.strategy) + shift
            _success(success, row, y, height, colour)
            _range(time_s, row, y, height, colour, lambda trial: trial.duration_s if trial.inserted else None)
            _range(force_n, row, y, height, colour, lambda trial: trial.peak_force_n)
            if row.mean_score is not None:
                score.barh(y, row.mean_score, 0.85 * height, color=colour)
        success.barh(0.0, 0.0, 0.0, color=colour, label=name)
    success.set_xlim(0.0, 100.0)
    score.set_xlim(0.0, 100.0)
    time_s.set_xscale("log")
    titles = (
        (success, "inserted, %\n(bar: 95 % Wilson)"),
        (time_s, "time of the inserted, s\n(line: 5 to 95 %, dot: median)"),
        (force_n, "peak force, N\n(line: 5 to 95 %, dot: median)"),
        (score, "challenge score, adapted\n(mean, of 100)"),
    )
    for axes, title in titles:
        axes.set_title(title, fontsize=10)
        axes.grid(axis="x", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    time_s.set_xticks(TICKS_S, [f"{tick:g}" for tick in TICKS_S], minor=False)
    time_s.xaxis.set_minor_formatter("")
    force_n.set_xlim(left=0.0)
    success.set_yticks(range(len(strategies)), [strategy.replace("_", " ") for strategy in strategies])
    success.set_ylim(len(strategies) - 0.5, -0.5)
    trials = max(row.all.trials for row in comparison.rows)
    figure.legend(loc="outside lower center", ncols=len(names), frameon=False)
    figure.suptitle(f"The same {trials} seeds from {comparison.seed} for every strategy", fontsize=11)
    return figure


def _success(axes: Axes, row: ComparedStrategy, y: float, height: float, colour: str) -> None:
    rate = 100.0 * row.all.success_rate
    low, high = 100.0 * row.all.wilson95_low, 100.0 * row.all.wilson95_high
    axes.barh(y, rate, 0.85 * height, color=colour)
    # rounding may put the rate slightly outside its own interval
    axes.errorbar(
        rate, y, xerr=[[max(rate - low, 0.0)], [max(high - rate, 0.0)]], ecolor="black", elinewidth=0.9, capsize=2.0,
        # a bar of length zero has no colour
        fmt="s", markersize=4.0, color=colour, clip_on=False, zorder=3.0,
    )  # fmt: skip


def _range(
    axes: Axes,
    row: ComparedStrategy,
    y: float,
    height: float,
    colour: str,
    value: Callable[[TrialFigures], float | None],
) -> None:
    values = [got for trial in row.all.each if (got := value(trial)) is not None]
    if not values:
        return
    low, middle, high = np.percentile(values, [5.0, 50.0, 95.0])
    axes.plot([low, high], [y, y], color=colour, linewidth=max(1.5, 8.0 * height), solid_capstyle="butt", alpha=0.55)
    axes.plot([middle], [y], marker="o", markersize=4.5, color=colour, markeredgecolor="white", markeredgewidth=0.6)
