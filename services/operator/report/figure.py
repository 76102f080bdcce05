"""Figures drawn with matplotlib as `<svg>` elements that take the colours and fonts of the page they stand in."""

from __future__ import annotations

import io
import re
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from crosspih_common.recording.plotting import LINES

# placeholder for the page's own text colour in any theme; replaced after drawing
INK = "#010203"
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
    # as wide as the page; the height follows from the viewBox
    svg = re.sub(r'(<svg\b[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    return re.sub(r'(<svg\b[^>]*?) width="[^"]*"', r'\1 width="100%"', svg, count=1)


__all__ = ["FIGURE_STYLE", "INK", "LINES", "inline_svg"]
