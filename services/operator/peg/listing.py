"""`crosspih peg list`."""

from __future__ import annotations

import json
import sys
from typing import Any

from rich.console import Console
from rich.table import Table

from crosspih_common.config import Workcell, load_cell
from crosspih_common.config.drawing import OUTLINES, PegDrawing
from services.operator.cell.which_cell import cell_path
from services.operator.cli.failure import errors_shown
from services.operator.cli.options import AsJson


def rows_of(workcell: Workcell) -> list[dict[str, Any]]:
    """One row for each named outline; first the cell's own where it has no name. Pure."""
    own = workcell.peg
    drawings = {name: PegDrawing(outline=name) for name in OUTLINES}
    rows = [_row(name, own if name == own.outline else drawn, name == own.outline) for name, drawn in drawings.items()]
    return rows if own.outline in drawings else [_row(own.outline, own, True), *rows]


def _row(name: str, drawing: PegDrawing, own: bool) -> dict[str, Any]:
    outline = drawing.shape().outline
    return {
        "name": name, "of_the_cell": own, "looks_the_same_after_turns": outline.symmetry_order,
        "corners": len(outline.corners_m), "area_mm2": round(outline.area_m2 * 1e6, 2),
        "farthest_wall_mm": round(outline.radius_m * 1e3, 2),
    }  # fmt: skip


def list_pegs(as_json: AsJson = False) -> None:
    """The pegs that can be named, and the cell's own."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        rows = rows_of(load_cell(cell_path()).workcell)
        if as_json:
            json.dump(rows, sys.stdout, indent=1)
            print()
            return
        table = Table("name", "same after", "corners", "area mm²", "farthest wall mm", "")
        for row in rows:
            turns = row["looks_the_same_after_turns"]
            same = {0: "any turn", 1: "a whole turn"}.get(turns, f"1/{turns} turn")
            said = "the cell's own" if row["of_the_cell"] else ""
            sizes = (str(row["corners"]), f"{row['area_mm2']:.1f}", f"{row['farthest_wall_mm']:.2f}")
            table.add_row(row["name"], same, *sizes, said)
        console.print(table)
        console.print("--peg takes a name or a drawing: crosspih peg check FILE.svg (docs/pegs.md)", highlight=False)
