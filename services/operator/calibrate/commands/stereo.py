"""`crosspih calibrate stereo`: both lenses, and where the right camera stands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.config import CellFile
from services.operator.bench.options import AsJson
from services.operator.calibrate.commands.by_pairs import (
    BoardOption,
    FoundCameras,
    FromOption,
    HandOption,
    PageOption,
    PairsOption,
    calibrate_by_pairs,
)
from services.operator.calibrate.folder import Taken
from services.operator.calibrate.options import CellOption, RecordOption, ShareOption, SpeedOption
from services.operator.calibrate.pairs import Pairs, WantedPairs
from services.operator.calibrate.tables import values_table


def stereo(
    pattern: BoardOption = None,
    files: FromOption = None,
    pairs: PairsOption = 20,
    by_hand: HandOption = False,
    model: Annotated[
        str | None, typer.Option(help="Size of the distortion, such as 'k1 k2 p1 p2'; by held-out error when left out.")
    ] = None,
    gamma: Annotated[
        str | None, typer.Option(help="Of the pictures of --from: linear, or srgb for photos; left out: as was told.")
    ] = None,
    cameras: Annotated[Path | None, typer.Option(help="Where the camera message goes (docs/locate.md).")] = None,
    cell: CellOption = None,
    share: ShareOption = 0.3,
    speed: SpeedOption = None,
    page: PageOption = True,
    record: RecordOption = False,
    as_json: AsJson = False,
) -> None:
    """Both lenses and where the right camera stands, by a ChArUco board; written as locate and drivers read it."""

    def find(shown_pairs: Pairs, file: CellFile) -> FoundCameras:
        taken = shown_pairs.taken
        result = shown_pairs.ask("stereo", shown_pairs.jobs(gamma or _gamma(taken)), model=model)
        message = dict(result["calibration"])
        if taken.calibration is not None:
            message["pose_base_camera"] = taken.calibration.pose_base_camera.model_dump(mode="json")
        return FoundCameras(result, message, lambda shown: _show(shown, result), cameras)

    wanted = WantedPairs(
        pattern, files, pairs, by_hand, poses=False, share=share, speed=speed, page=page, record=record
    )
    calibrate_by_pairs("stereo", wanted, cell, as_json, find)


def _gamma(taken: Taken) -> str:
    return "linear" if taken.calibration is None else taken.calibration.left.gamma.value


def _show(shown: Console, result: dict[str, Any]) -> None:
    shown.print(values_table(f"{result['pairs']} pairs, {result['corners']} corners", result["values"]))
    for name, left_out in result["held_out_px"].items():
        mark = "  <- taken" if name == result["model"] else ""
        shown.print(f"left out, {name}: {left_out:.4f} px{mark}", highlight=False)
    shown.print(
        f"residual {result['rms_px']:.3f} px, {result['rms_mm']:.4f} mm; left out {result['held_out_mm']:.4f} "
        f"mm; {result['wild']} corners were wild; worst pair {result['worst_pair'] + 1}",
        highlight=False,
    )  # fmt: skip
