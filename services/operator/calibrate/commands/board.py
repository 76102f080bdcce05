"""`crosspih calibrate board`: the board to print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.errors import ConfigError
from services.operator.bench.options import errors_shown
from services.operator.calibrate.options import BOARD_HELP
from services.operator.calibrate.taking import VISION, ask
from services.operator.locate.worker import OfflineVision


def board(
    out: Annotated[Path, typer.Argument(help="A file that ends in .pdf (true size) or .png (300 dpi).")],
    pattern: Annotated[str, typer.Option("--board", help=BOARD_HELP)] = "9x6:0.02:0.015:DICT_4X4_50",
) -> None:
    """Write the ChArUco board to print: at 100 %, on something flat and stiff; check the ruler on it."""
    console = Console()
    with errors_shown(console):
        if not out.absolute().parent.is_dir():
            raise ConfigError(f"{out}: its folder is not there; make it first", field=str(out))
    with errors_shown(console), OfflineVision(VISION) as vision:
        drawn = ask(vision, {"do": "board", "board": pattern, "out": str(out)})
        width, height = (value * 1e3 for value in drawn["size_m"])
        console.print(f"{out}: {pattern}, {width:g} x {height:g} mm of squares", highlight=False)
