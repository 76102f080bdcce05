"""The heat map of `crosspih bench domain`: a row per factor, a box per level, with its success by colour and count."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from services.operator.bench.domain.boxes import MapBox

_INK, _PALE = "#1b1f24", "#f2f2f2"


def draw_map(boxes: Sequence[MapBox], strategy: str, trials: int, wanted: float, path: Path) -> None:
    """Draw it as a PNG. The scale begins at 0.5: everything below is a failure."""
    # takes time to load: commands that draw nothing should not wait for it
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.colors import ListedColormap, Normalize
    from matplotlib.patches import Rectangle

    rows: dict[str, list[MapBox]] = {}
    for box in boxes:
        rows.setdefault(box.factor, []).append(box)
    most = max(len(row) for row in rows.values())
    # from red over pale yellow to light blue: most eyes can tell them apart, and dark letters are readable on all of it
    colours = ListedColormap(matplotlib.colormaps["RdYlBu"](np.linspace(0.12, 0.74, 256)))
    scale = Normalize(0.5, 1.0)
    figure, axes = pyplot.subplots(figsize=(1.75 * most + 2.4, 0.78 * len(rows) + 1.2), layout="constrained")
    for number, row in enumerate(rows.values()):
        for column, box in enumerate(row):
            rate = None if box.result is None else box.result.success_rate
            face = _PALE if rate is None else colours(scale(max(rate, 0.5)))
            edge = _INK if box.is_default else "white"
            axes.add_patch(
                Rectangle((column + 0.03, number + 0.03), 0.94, 0.94, facecolor=face, edgecolor=edge, linewidth=2.2)
            )
            count = "-" if box.result is None else f"{box.result.inserted}/{box.result.trials}"
            weak = rate is not None and rate < wanted
            axes.text(column + 0.5, number + 0.36, box.level, ha="center", va="center", fontsize=9, color=_INK)
            axes.text(
                column + 0.5, number + 0.68, count, ha="center", va="center", fontsize=11, color=_INK,
                fontweight="bold" if weak else "normal",
            )  # fmt: skip
    axes.set_xlim(0.0, most)
    axes.set_ylim(len(rows), 0.0)
    axes.set_xticks([])
    names = [name + ("" if row[0].known else "\n(not told)") for name, row in rows.items()]
    axes.set_yticks([number + 0.5 for number in range(len(rows))], names)
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_title(
        f"inserted of {trials}, {strategy}, one factor at a time; outlined: the default cell;\n"
        f"bold: below {wanted:.0%}; not told: the services do not know of it",
        fontsize=10,
    )
    mappable = matplotlib.cm.ScalarMappable(scale, colours)
    figure.colorbar(mappable, ax=axes, label="share inserted", fraction=0.04, pad=0.02, extend="min")
    figure.savefig(path, dpi=130)
    pyplot.close(figure)
