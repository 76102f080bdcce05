"""`crosspih bench sizes`."""

from __future__ import annotations

import os
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.config import load_cell
from crosspih_common.config.cell import content_alone
from services.operator.bench.cells.own_cell import CellTask, OwnCell
from services.operator.bench.options import AsJson, errors_shown
from services.operator.bench.speed.sizes import SIZES, SizesResult, content_at, row_of, table_of
from services.operator.cell.which_cell import cell_path


def sizes(
    pairs: Annotated[int, typer.Option(min=1, help="Pairs of pictures a size.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1000,
    largest: Annotated[int, typer.Option(min=320, help="Leave out pictures wider than this, px.")] = 2448,
    as_json: AsJson = False,
) -> None:
    """Time vision on pictures from 320 x 240 to 2448 x 2048, each in a simulated cell of its own."""
    console = Console(stderr=True)
    with errors_shown(console):
        cell = load_cell(cell_path())
        content = content_alone(cell)
        rows = []
        before = dict(os.environ)
        for width_px, height_px in SIZES:
            if width_px > largest:
                continue
            changed = content_at(content, cell.workcell.camera, width_px, height_px)
            task = CellTask(
                f"{width_px} x {height_px}",
                changed,
                row_of,
                (width_px, height_px, range(seed, seed + pairs)),
                services=("hardware", "vision"),
                calibrate=False,
            )
            own = OwnCell(0, task)
            try:
                with console.status(f"pictures of {width_px} x {height_px}"):
                    rows.append(row_of(own.start(), task.payload))
                done = f"pictures of {task.label}: {rows[-1].located} of {rows[-1].pairs} located"
                console.print(done, highlight=False)
            finally:
                own.close()
                os.environ.clear()
                os.environ.update(before)
        result = SizesResult(rows=rows)
        if as_json:
            print(result.model_dump_json())
        else:
            Console().print(table_of(result))
