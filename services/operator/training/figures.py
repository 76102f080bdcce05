"""The figures of a training as inline SVG: the paper's Figure 18, learning curves, errors beside the floor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from services.operator.report.figure import FIGURE_STYLE, INK, LINES, inline_svg

NAMES = ("α, about z", "β, about y", "γ, about x")
TRUE, SAID, OFF = LINES[2], LINES[0], LINES[1]


def _new(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.patch.set_alpha(0.0)
    return figure


def _finish(figure: Figure) -> str:
    for axes in figure.axes:
        axes.patch.set_alpha(0.0)
        axes.spines[["top", "right"]].set_visible(False)
    return inline_svg(figure)


def sample_figure(true_deg: Any, said_deg: Any, said: str, others: Sequence[tuple[str, Any]] = ()) -> str:
    """The paper's Figure 18: for each angle the true value, the network's, and the error, sample by sample.

    true_deg, said_deg (n, 3). `others`: more predictions (name, (n, 3)) for comparison.
    """
    true, predicted = np.asarray(true_deg, float), np.asarray(said_deg, float)
    number = np.arange(1, len(true) + 1)
    with rc_context(FIGURE_STYLE):
        figure = _new(10.0, 7.2)
        grid = figure.subplots(3, 1, sharex=True)
        for index, (axes, name) in enumerate(zip(grid, NAMES, strict=True)):
            order = number
            axes.plot(order, true[:, index], "o-", color=TRUE, markersize=3.5, linewidth=0.8, label="true")
            axes.plot(order, predicted[:, index], "s-", color=SAID, markersize=3.0, linewidth=0.8, label=said)
            for shade, (other, values) in enumerate(others):
                axes.plot(
                    order, np.asarray(values)[:, index], "^:", color="#b07cc6" if shade == 0 else "#8a8d93",
                    markersize=3.5, linewidth=0.8, label=other,
                )  # fmt: skip
            axes.bar(
                order, predicted[:, index] - true[:, index], width=0.55, color=OFF, alpha=0.55, label=f"error, {said}"
            )
            axes.axhspan(-1.0, 1.0, color=INK, alpha=0.06, linewidth=0)
            axes.axhline(0.0, color=INK, linewidth=0.4)
            axes.set_ylabel(f"{name} / °")
        grid[0].legend(loc="lower left", ncols=5, frameon=False, bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        grid[-1].set_xlabel("sample")
        grid[-1].set_xlim(0.0, len(true) + 1.0)
        return _finish(figure)


def scatter_figure(true_deg: Any, said_deg: Any, limit_deg: float) -> str:
    """The network's value against the true one for each angle (n, 3): right answers are on the diagonal, and a flat
    line is guessing the mean.
    """
    true, predicted = np.asarray(true_deg, float), np.asarray(said_deg, float)
    with rc_context(FIGURE_STYLE):
        figure = _new(10.0, 4.3)
        for index, (axes, name) in enumerate(zip(figure.subplots(1, 3, sharex=True, sharey=True), NAMES, strict=True)):
            axes.plot([-limit_deg, limit_deg], [-limit_deg, limit_deg], color=INK, linewidth=0.6, linestyle=":")
            axes.plot(true[:, index], predicted[:, index], "o", color=LINES[index], markersize=2.6, alpha=0.55)
            axes.set_title(name, fontsize=9.5)
            axes.set_xlabel("true / °")
            axes.set_aspect("equal")
            axes.set_xlim(-limit_deg, limit_deg)
            axes.set_ylim(-limit_deg, limit_deg)
            if index == 0:
                axes.set_ylabel("said / °")
        return _finish(figure)


def curve_figure(curves: dict[str, Any], goal: float) -> str:
    """Mean square error over the epochs, training and validation, and the epoch whose weights were kept."""
    with rc_context(FIGURE_STYLE):
        figure = _new(10.0, 3.2)
        axes = figure.subplots()
        axes.semilogy(curves["epoch"], curves["training"], color=TRUE, label="training")
        if curves["validation"]:
            axes.semilogy(curves["epoch"], curves["validation"], color=SAID, label="validation")
            axes.axvline(curves["best"], color=INK, linewidth=0.8, linestyle=":", label=f"kept: {curves['best']}")
        if goal > 0.0:
            axes.axhline(goal, color=INK, linewidth=0.6, linestyle=(0, (4, 2)), label=f"goal {goal:g}")
        axes.set_xlabel("epoch")
        axes.set_ylabel("mean square error, outputs 0..1")
        axes.legend(frameon=False, ncols=4)
        return _finish(figure)


def error_figure(groups: Sequence[tuple[str, Sequence[float]]]) -> str:
    """The RMS error of each angle for several estimators: (name, three degrees)."""
    with rc_context(FIGURE_STYLE):
        figure = _new(10.0, 3.2)
        axes = figure.subplots()
        width = 0.8 / len(groups)
        shades = np.linspace(0.25, 0.95, len(groups))
        for number, (name, values) in enumerate(groups):
            places = np.arange(3) + (number - (len(groups) - 1) / 2.0) * width
            bars = axes.bar(places, values, width=0.92 * width, color=LINES[2], alpha=float(shades[number]), label=name)
            axes.bar_label(bars, fmt="%.2f", fontsize=7.5, padding=1.5)
        axes.set_xticks(np.arange(3), NAMES)
        axes.set_ylabel("RMS error / °")
        axes.margins(y=0.15)
        axes.legend(frameon=False, ncols=3, loc="upper left", bbox_to_anchor=(0.0, 1.25), borderaxespad=0.0)
        return _finish(figure)
