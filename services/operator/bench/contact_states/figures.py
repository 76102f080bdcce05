"""The pictures of `crosspih bench states`: confusion, n_z0 against the paper's bands, reliability."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crosspih_common.contacts.axial_share import with_friction
from services.operator.bench.contact_states.judged import CLASSIFIERS, Judged
from services.operator.bench.contact_states.labels import NONE
from services.operator.bench.contact_states.summary import NAMES, axial_share, confusion, reliability

PAPER_BANDS = {"1": (0.23, 0.31), "2": (0.33, 0.42), "3": (0.58, 0.71), "4": (0.97, 1.0)}
"""The ranges of |n_z0| of one to four contacts that the paper prints (its Figure 10); the last is "about 1"."""
_COLOURS = ("#4a7fd6", "#2f9e6e", "#d98a3d", "#8a5fc4")
_BAND = "#f0c040"
_DPI = 110


def draw_confusion(judged: Sequence[Judged], path: Path) -> None:
    """Both classifiers side by side: each row shows the shares of one true state."""
    figure = Figure(figsize=(17.5, 8.6), layout="constrained")
    for column, classifier in enumerate(CLASSIFIERS):
        axes = figure.add_subplot(1, 2, column + 1)
        counts = confusion(judged, classifier)
        shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
        image = axes.imshow(shares, vmin=0.0, vmax=1.0, cmap="Blues")
        for row in range(len(NAMES)):
            for place in np.flatnonzero(shares[row] >= 0.005).tolist():
                ink = "white" if shares[row, place] > 0.55 else "black"
                text = f"{100.0 * shares[row, place]:.0f}"
                axes.text(place, row, text, ha="center", va="center", fontsize=6.5, color=ink)
        axes.set_xticks(range(len(NAMES)), NAMES, rotation=90, fontsize=8)
        axes.set_yticks(range(len(NAMES)), [f"{n} ({c})" for n, c in zip(NAMES, counts.sum(axis=1), strict=True)])
        axes.tick_params(axis="y", labelsize=8)
        for border in (7.5, 15.5, 23.5, 25.5):
            axes.axhline(border, color="#888888", linewidth=0.7)
            axes.axvline(border, color="#888888", linewidth=0.7)
        axes.set_xlabel("named")
        axes.set_ylabel("true (contacts)")
        right = np.trace(counts)
        axes.set_title(f"{classifier.value}: {right} of {counts.sum()} right")
        if column:
            figure.colorbar(image, ax=axes, shrink=0.7, label="share of the true state (figures: %)")
    figure.savefig(path, dpi=_DPI)


def draw_bands(judged: Sequence[Judged], friction: float, path: Path) -> None:
    """n_z0 of contacts with one to four arms of one sense, and of none of the 26, by stiffness; with the paper's bands,
    and these bands for the expected friction coefficient.
    """
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    axes = figure.add_subplot()
    stiffnesses = sorted({one.contact.stiffness_n_mm for one in judged}, key=lambda n_mm: (n_mm == 0.0, n_mm))
    groups = (*PAPER_BANDS, NONE)
    for place, group in enumerate(groups):
        if group in PAPER_BANDS:
            low, high = PAPER_BANDS[group]
            axes.fill_between([place - 0.46, place + 0.46], low, high, color=_BAND, alpha=0.55, linewidth=0.0)
            for edge in (low, high):
                moved = with_friction(edge, int(group), friction)
                axes.hlines(moved, place - 0.46, place + 0.46, color="#a07000", linestyle="--", linewidth=1.0)
        for number, stiffness in enumerate(stiffnesses):
            values = [
                axial_share(one)
                for one in judged
                if one.contact.stiffness_n_mm == stiffness
                and (one.contact.truth.name == NONE if group == NONE else one.contact.truth.name[0] == group)
            ]
            if len(values) > 4:
                middle = place + 0.28 * (number - 0.5 * (len(stiffnesses) - 1))
                _violin(axes, values, middle, _COLOURS[number % len(_COLOURS)])
    for number, stiffness in enumerate(stiffnesses):
        label = "the cell's own arm" if stiffness == 0.0 else f"{stiffness:g} N/mm at the rim"
        axes.plot([], [], color=_COLOURS[number % len(_COLOURS)], linewidth=6, alpha=0.6, label=label)
    axes.fill_between([], [], color=_BAND, alpha=0.55, label="the paper's band")
    axes.plot([], [], color="#a07000", linestyle="--", linewidth=1.0, label=f"with friction {friction:g}")
    labels = [f"{group} arm{'s' if group != '1' else ''}" for group in PAPER_BANDS]
    axes.set_xticks(range(len(groups)), [*labels, "none of the 26"])
    axes.set_ylim(0.0, 1.03)
    axes.set_ylabel("n_z0 = |Fz| / |F|")
    axes.set_title("Axial share of contacts by the arms that truly touch (bar: 25 to 75 %, dot: median)")
    axes.legend(loc="lower right", fontsize=9)
    figure.savefig(path, dpi=_DPI)


def _violin(axes: Axes, values: list[float], place: float, colour: str) -> None:
    parts = axes.violinplot([values], [place], widths=0.26, showextrema=False)
    for body in np.atleast_1d(np.asarray(parts["bodies"], dtype=object)):
        body.set_facecolor(colour)
        body.set_alpha(0.45)
    low, middle, high = np.percentile(values, [25, 50, 75])
    axes.vlines(place, low, high, color=colour, linewidth=3)
    axes.plot(place, middle, "o", color="white", markeredgecolor=colour, markersize=4)


def draw_reliability(judged: Sequence[Judged], path: Path) -> None:
    """Stated confidence against the share that is right, for named states."""
    figure = Figure(figsize=(5.4, 5.0), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], [0.0, 1.0], color="#999999", linewidth=0.8)
    for number, classifier in enumerate(CLASSIFIERS):
        rows = reliability(judged, classifier)
        axes.plot(
            [row["confidence"] for row in rows],
            [row["share"] for row in rows],
            "o-",
            color=_COLOURS[number],
            label=classifier.value,
        )
        for row in rows:
            axes.annotate(
                f"{row['of']:.0f}", (row["confidence"], row["share"]), (3, -9), textcoords="offset points", fontsize=7
            )
    axes.set_xlabel("confidence given")
    axes.set_ylabel("share right")
    axes.set_xlim(0.0, 1.02)
    axes.set_ylim(0.0, 1.02)
    axes.legend()
    figure.savefig(path, dpi=_DPI)
