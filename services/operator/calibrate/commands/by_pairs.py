"""What the calibrations by pairs of pictures share: their options, how the pairs are taken, and what is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.config import CellFile, load_cell
from services.operator.bench.options import errors_shown
from services.operator.calibrate.options import BOARD_HELP
from services.operator.calibrate.pairs import Pairs, WantedPairs, taken_pairs
from services.operator.calibrate.writing import CalibrationResult
from services.operator.cell.which_cell import cell_path, using_cell

CAMERAS = "cameras.yaml"
FROM_HELP = (
    "Offline: a folder that a calibration left, pictures with left and right in their names, or a recording (.mcap)."
)
BoardOption = Annotated[str | None, typer.Option("--board", help=BOARD_HELP)]
FromOption = Annotated[list[Path] | None, typer.Option("--from", help=FROM_HELP)]
PairsOption = Annotated[int, typer.Option(min=5, max=200, help="How many the arm shows.")]
HandOption = Annotated[bool, typer.Option("--by-hand", help="You show the board, or move the arm; Enter takes a pair.")]
PageOption = Annotated[bool, typer.Option("--page/--no-page", help="Live pictures for a browser on this machine.")]


@dataclass(frozen=True, slots=True)
class FoundCameras:
    """What a calibration found in its pairs: for JSON, as a camera message, and how people are shown it.

    `cameras` is where the message goes, `out` where the cell's file goes; without: into the calibration's folder, and
    nowhere.
    """

    result: dict[str, Any]
    message: dict[str, Any]
    show: Callable[[Console], None]
    cameras: Path | None = None
    out: Path | None = None


def calibrate_by_pairs(
    kind: str, wanted: WantedPairs, cell: Path | None, as_json: bool, find: Callable[[Pairs, CellFile], FoundCameras]
) -> None:
    """Take or read the pairs, calibrate by `find(pairs, the cell's file)`, write the result and show it."""
    console = Console(stderr=True)
    with errors_shown(console), using_cell(cell):
        file = load_cell(cell_path())
        with taken_pairs(console, kind, file, wanted) as pairs:
            found = find(pairs, file)
        cameras = (found.cameras or pairs.own / CAMERAS, found.message)
        CalibrationResult(
            kind, file, pairs.own, found.result, pairs.taken.taken_at.isoformat(), found.out, cameras
        ).conclude(as_json, found.show)
