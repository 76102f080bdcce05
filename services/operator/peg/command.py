"""`crosspih peg check FILE`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from crosspih_common.config import load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry.pose import Array
from services.operator.bench.options import AsJson, errors_shown
from services.operator.cell.which_cell import cell_path
from services.operator.peg.checking import Checked, check


def check_drawing(
    file: Annotated[Path, typer.Argument(help="The drawing, SVG or DXF.")],
    as_json: AsJson = False,
    picture: Annotated[
        Path | None, typer.Option(help="Draw what was read into this file: PNG, SVG or PDF by its name.")
    ] = None,
) -> None:
    """Tell what a drawing is read as, and what is left out; exit status 0 only if it can be a peg and its hole."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        checked = check(file, load_cell(cell_path()).workcell.hole)
        if picture is not None and checked.drawing is not None:
            _picture(checked, picture)
    report = checked.report
    if as_json:
        print(report.model_dump_json())
    else:
        if checked.drawing is not None:
            console.print(_table(checked))
        if picture is not None and checked.drawing is not None:
            console.print(f"picture   {picture}", highlight=False, markup=False)
        if report.refusal is not None:
            console.print(report.refusal, style="red", markup=False, highlight=False, soft_wrap=True)
        else:
            console.print("it can be a peg and a hole", style="green")
    if report.refusal is not None:
        raise typer.Exit(1)


def _table(checked: Checked) -> Table:
    report, table = checked.report, Table(show_header=False)
    drawing = checked.drawing
    assert drawing is not None
    turns = {0: "any turn looks the same: a round", 1: "no turn looks the same"}
    symmetry = report.symmetry or 0
    rows = [
        ("outline", drawing.entity),
        ("area", f"{report.area_mm2:.3f} mm²"),
        ("width x height", f"{report.width_mm:.3f} x {report.height_mm:.3f} mm"),
        ("corners", str(report.corners)),
        ("symmetry", turns.get(symmetry, f"{symmetry} turns look the same")),
    ]
    if checked.peg is not None:
        outline = checked.peg.outline
        rows.append(("the peg's polygon", f"{len(outline.corners_m)} corners, {outline.area_m2 * 1e6:.3f} mm²"))
        rows.append(
            ("nearest and farthest wall", f"{outline.inner_radius_m * 1e3:.3f} and {outline.radius_m * 1e3:.3f} mm")
        )
    rows += [("left out" if index == 0 else "", name) for index, name in enumerate(report.left_out or ["nothing"])]
    for name, value in rows:
        table.add_row(name, escape(value))
    return table


def _closed(points: Array) -> Array:
    return np.vstack([points, points[:1]]) * 1e3


def _picture(checked: Checked, out: Path) -> None:
    """The contour as read, filled; the peg's polygon and its axis over it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawing = checked.drawing
    assert drawing is not None
    figure = Figure(figsize=(7.0, 7.0))
    canvas, axes = FigureCanvasAgg(figure), figure.add_subplot()
    contour = _closed(drawing.contour.points_m)
    shift = np.zeros(2)
    if checked.peg is not None:
        corners = _closed(checked.peg.outline.corners_m)
        # the polygon is about the peg's axis, the contour about its centroid
        shift = corners[:, :2].min(axis=0) - _closed(_chords(checked)).min(axis=0)
        axes.plot(
            *corners.T, "o-", color="tab:red", lw=0.8, ms=2.5, label=f"the peg's polygon, {len(corners) - 1} corners"
        )
        axes.plot([0.0], [0.0], "+", color="black", ms=14, label="the peg's axis")
    axes.fill(*(contour + shift).T, color="tab:blue", alpha=0.25, label="the contour as read")
    report = checked.report
    axes.set_title(f"{drawing.path.name}: {report.area_mm2} mm², {report.width_mm} x {report.height_mm} mm", fontsize=9)
    axes.set_xlabel("x, mm")
    axes.set_ylabel("y, mm")
    axes.set_aspect("equal")
    axes.legend(loc="lower right", fontsize=8)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        canvas.print_figure(out, dpi=120)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--picture {out}: cannot be written ({error}); name a .png, .svg or .pdf") from None


def _chords(checked: Checked) -> Array:
    """The polygon about the contour's centroid."""
    assert checked.drawing is not None and checked.peg is not None
    corners = checked.peg.outline.corners_m
    for tolerance_m in (5e-5, 1e-4, 2e-4):
        found = checked.drawing.contour.chords(tolerance_m)
        if len(found) == len(corners):
            return found
    return corners
