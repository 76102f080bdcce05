"""The paper's Figure 19 as inline SVG: contact force and moment over the cell's time, phases and touches marked."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crosspih_common.messages import Phase
from services.operator.report.content import Content

# stands for the page's own text colour, whichever theme it has; replaced after drawing
INK = "#010203"
# readable on white and on near-black
LINES = ("#d9534f", "#2f9e6e", "#4a7fd6")
PHASE_COLOURS = {
    Phase.CALIBRATING: "#8a8d93",
    Phase.LOCATING: "#b07cc6",
    Phase.APPROACHING: "#5b9bd5",
    Phase.PUSHING: "#e0a03c",
    Phase.TOUCHING: "#d96c5f",
    Phase.ESTIMATING: "#c66ba0",
    Phase.CORRECTING: "#45a3a3",
    Phase.SEATED: "#5fae57",
    Phase.BACKING_OFF: "#a0522d",
    Phase.DONE: "#6f9f3f",
}
FIGURE_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "crosspih",
    "font.family": "sans-serif",
    "font.size": 9.5,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "path.simplify": True,
    "path.simplify_threshold": 0.2,
    "lines.linewidth": 1.1,
}


def draw_figure(content: Content) -> Figure | None:
    """The figure; None when there is neither a wrench nor a phase to draw."""
    if content.time_s.size == 0 and not content.spans:
        return None
    end_s = max([1e-3, *content.time_s.tolist()[-1:], *(span.end_s for span in content.spans)])
    with rc_context(FIGURE_STYLE):
        figure = Figure(figsize=(10.0, 6.2), layout="constrained")
        figure.patch.set_alpha(0.0)
        strip, force, moment = figure.subplots(3, 1, sharex=True, height_ratios=[0.22, 2.2, 1.8])
        _draw_strip(strip, content, end_s)
        names = ("x", "y", "z")
        for axes, first, symbol, unit in ((force, 0, "F", "N"), (moment, 3, "M", "Nm")):
            axes.patch.set_alpha(0.0)
            _shade(axes, content)
            if content.time_s.size:
                for offset in range(3):
                    axes.plot(
                        content.time_s,
                        content.wrench[:, first + offset],
                        color=LINES[offset],
                        label=f"{symbol}{names[offset]}",
                    )
                magnitude = np.linalg.norm(content.wrench[:, first : first + 3], axis=1)
                axes.plot(
                    content.time_s, magnitude, color=INK, linewidth=0.8, linestyle=(0, (4, 2)), label=f"|{symbol}|"
                )
                axes.legend(loc="upper left", ncols=4, frameon=False, handlelength=1.6, columnspacing=1.4)
                # room for the legend above the curves
                low, high = axes.get_ylim()
                axes.set_ylim(low, high + 0.18 * (high - low))
            axes.axhline(0.0, color=INK, linewidth=0.4, alpha=0.5)
            axes.set_ylabel(f"contact {'force' if symbol == 'F' else 'moment'} / {unit}")
            axes.spines[["top", "right"]].set_visible(False)
            for entry in content.touches:
                axes.axvline(entry.time_s, color=INK, linewidth=0.8, linestyle=":")
        for label, time_s in _touch_labels(content, end_s):
            force.annotate(
                label,
                (time_s, 1.0),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="bottom",
                fontsize=8.5,
                fontweight="bold",
                annotation_clip=False,
            )
        moment.set_xlabel("cell time since the command / s")
        moment.set_xlim(0.0, end_s)
    return figure


def _touch_labels(content: Content, end_s: float) -> list[tuple[str, float]]:
    """Touch numbers; those too near to their neighbour to be read share one label."""
    labels: list[tuple[list[int], float]] = []
    for number, entry in enumerate(content.touches, start=1):
        if labels and entry.time_s - labels[-1][1] < 0.02 * end_s:
            labels[-1][0].append(number)
        else:
            labels.append(([number], entry.time_s))
    return [(str(numbers[0]) if len(numbers) == 1 else f"{numbers[0]}–{numbers[-1]}", at) for numbers, at in labels]


def _draw_strip(axes: Axes, content: Content, end_s: float) -> None:
    axes.axis("off")
    axes.set_ylim(0.0, 1.0)
    for span in content.spans:
        width = span.end_s - span.start_s
        colour = PHASE_COLOURS.get(span.message.phase, "#888888")
        axes.barh(0.35, max(width, 0.002 * end_s), left=span.start_s, height=0.7, color=colour, linewidth=0)
        word = span.message.phase.value.replace("_", " ")
        # about 100 characters of this size stand side by side
        if width / end_s * 105.0 > len(word) + 1:
            axes.text(
                span.start_s + width / 2.0,
                0.35,
                word,
                ha="center",
                va="center",
                fontsize=8.0,
                color="white",
                clip_on=True,
            )


def _shade(axes: Axes, content: Content) -> None:
    for span in content.spans:
        if span.end_s > span.start_s:
            colour = PHASE_COLOURS.get(span.message.phase, "#888888")
            axes.axvspan(span.start_s, span.end_s, color=colour, alpha=0.13, linewidth=0)


def figure_svg(content: Content) -> str | None:
    """The figure as an `<svg>` element whose text takes the page's colour and font; None when nothing can be drawn."""
    figure = draw_figure(content)
    return None if figure is None else inline_svg(figure)


def inline_svg(figure: Figure) -> str:
    """A figure drawn in FIGURE_STYLE as an `<svg>` element for a page: text in the page's own colour and font."""
    buffer = io.StringIO()
    with rc_context(FIGURE_STYLE):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    svg = text[text.index("<svg") :].replace(INK, "currentColor")
    for pattern, instead in (
        (r"<metadata>.*?</metadata>", ""),
        # inside HTML an <svg> needs no namespaces: without them the page holds no address of any kind
        (r' xmlns(:xlink)?="[^"]*"', ""),
        (r"xlink:href", "href"),
        (r'(font: [^;"]*?px) [^;"]*', r"\1 system-ui, sans-serif"),
    ):
        svg = re.sub(pattern, instead, svg, flags=re.DOTALL)
    # as wide as the page, the height follows from the viewBox
    svg = re.sub(r'(<svg\b[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    return re.sub(r'(<svg\b[^>]*?) width="[^"]*"', r'\1 width="100%"', svg, count=1)


__all__ = ["FIGURE_STYLE", "INK", "LINES", "PHASE_COLOURS", "draw_figure", "figure_svg", "inline_svg"]
