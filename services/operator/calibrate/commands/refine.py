"""`crosspih calibrate refine`: the cell's drawing and its sensors' mountings refined over past recordings."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.config import load_cell
from crosspih_common.config.cell import standing_alone
from crosspih_common.errors import ConfigError
from crosspih_common.plain_yaml import yaml_of
from services.operator.bench.options import AsJson, errors_shown
from services.operator.calibrate.refined_cell import refined_table, residual_lines, run_refine, write_cell
from services.operator.cell.which_cell import cell_path


def refine(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings of assemblies, and of calibrations (MCAP).")],
    cell: Annotated[Path | None, typer.Option(help="The cell's file; that of CROSSPIH_CELL when left out.")] = None,
    out: Annotated[Path | None, typer.Option(help="Where the cell's file goes with the refined values.")] = None,
    as_json: AsJson = False,
) -> None:
    """Refine taper, clearance, F/T sensor and camera over past recordings of this cell."""
    console = Console(stderr=True)
    with errors_shown(console):
        path = cell or Path(cell_path())
        base = load_cell(path)
        if out is not None and out.resolve() == path.resolve():
            raise ConfigError(f"--out {out}: is the cell's file itself; name another, and compare the two")
        result = run_refine(recordings, path, console)
        if as_json:
            json.dump(result, sys.stdout, indent=1)
            print()
        else:
            shown = Console()
            shown.print(refined_table(result))
            for line in [*residual_lines(result), *result["notes"]]:
                shown.print(line, highlight=False, markup=False)
        if out is not None:
            write_cell(out, standing_alone(path, yaml_of(base.text) or {}), result, path.name)
            console.print(f"cell: {out}", highlight=False)
