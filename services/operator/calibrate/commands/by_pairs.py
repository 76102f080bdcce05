"""What the calibrations by pairs of pictures share: their options, how the pairs are taken, and what is written."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.config import load_cell
from services.operator.bench.options import AsJson, errors_shown
from services.operator.calibrate.options import BOARD_HELP, CellOption, RecordOption, ShareOption, SpeedOption
from services.operator.calibrate.pairs import WantedPairs, taken_pairs
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


def by_pairs(
    kind: str, usual: int, poses: bool = False
) -> Callable[[Callable[..., FoundCameras]], Callable[..., None]]:
    """A command with the options of taking pairs around its own: `find(pairs, file, **own)` is called with the pairs
    and the cell's file.

    `usual` is how many pairs the arm shows unless told otherwise; `poses` as `WantedPairs` has it.
    """

    def command_of(find: Callable[..., FoundCameras]) -> Callable[..., None]:
        def command(
            pattern: BoardOption = None,
            files: FromOption = None,
            pairs: PairsOption = usual,
            by_hand: HandOption = False,
            *,
            cell: CellOption = None,
            share: ShareOption = 0.3,
            speed: SpeedOption = None,
            page: PageOption = True,
            record: RecordOption = False,
            as_json: AsJson = False,
            **own: Any,
        ) -> None:
            console = Console(stderr=True)
            with errors_shown(console), using_cell(cell):
                file = load_cell(cell_path())
                wanted = WantedPairs(pattern, files, pairs, by_hand, poses, share, speed, page, record)
                with taken_pairs(console, kind, file, wanted) as taken:
                    found = find(taken, file, **own)
                cameras = (found.cameras or taken.own / CAMERAS, found.message)
                CalibrationResult(
                    kind, file, taken.own, found.result, taken.taken.taken_at.isoformat(), found.out, cameras
                ).conclude(as_json, found.show)

        command.__doc__, command.__name__ = find.__doc__, find.__name__
        _put_own_options_in(command, find)
        return command

    return command_of


def _put_own_options_in(command: Callable[..., None], find: Callable[..., FoundCameras]) -> None:
    """The options of `command` as typer sees them: those of `find` stand before the keyword-only ones."""
    shared = inspect.signature(command, eval_str=True)
    first = [one for one in shared.parameters.values() if one.kind is one.POSITIONAL_OR_KEYWORD]
    last = [one for one in shared.parameters.values() if one.kind is one.KEYWORD_ONLY]
    _, _, *own = inspect.signature(find, eval_str=True).parameters.values()
    parameters = [*first, *(one.replace(kind=one.KEYWORD_ONLY) for one in own), *last]
    command.__signature__ = shared.replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {one.name: one.annotation for one in parameters}
