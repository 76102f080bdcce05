"""`--cell FILE` for every command that uses a cell's file."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer

from services.operator.cell.which_cell import using_cell

CELL_HELP = "The cell's file; that of CROSSPIH_CELL when left out."
CellOption = Annotated[Path | None, typer.Option(help=CELL_HELP)]


def for_cell(command: Callable[..., None]) -> Callable[..., None]:
    """The command with one more option: `--cell FILE` is its cell's file while it runs."""

    @wraps(command)
    def called(*args: Any, cell: Path | None = None, **options: Any) -> None:
        with using_cell(cell):
            command(*args, **options)

    own = inspect.signature(command, eval_str=True)
    option = inspect.Parameter("cell", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=CellOption)
    parameters = [*own.parameters.values(), option]
    called.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return called
