"""`crosspih calibrate hand-eye`: where the cameras stand in the arm's base."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.config import CellFile
from crosspih_common.errors import ConfigError
from crosspih_common.messages import CameraCalibration
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
from services.operator.calibrate.folder import FOUND, Taken, read_yaml
from services.operator.calibrate.options import CellOption, RecordOption, ShareOption, SpeedOption
from services.operator.calibrate.pairs import Pairs, WantedPairs
from services.operator.calibrate.tables import values_table
from services.operator.calibrate.taking import doubt_of
from services.operator.locate.calibration_file import FileReading, read_calibration


def hand_eye(
    pattern: BoardOption = None,
    files: FromOption = None,
    pairs: PairsOption = 15,
    by_hand: HandOption = False,
    calibration: Annotated[
        Path | None, typer.Option(help="The cameras' file (`calibrate stereo`); left out: what the camera says.")
    ] = None,
    cameras: Annotated[Path | None, typer.Option(help="Where the camera message goes, with pose_base_camera.")] = None,
    out: Annotated[Path | None, typer.Option(help="Where the cell's file goes, with vision.camera_correction.")] = None,
    cell: CellOption = None,
    share: ShareOption = 0.3,
    speed: SpeedOption = None,
    page: PageOption = True,
    record: RecordOption = False,
    as_json: AsJson = False,
) -> None:
    """Where the cameras stand in the arm's base: the arm shows them a ChArUco board on its flange."""

    def find(shown_pairs: Pairs, file: CellFile) -> FoundCameras:
        taken = shown_pairs.taken
        known = _cameras(taken, calibration, file)
        jobs = shown_pairs.jobs(known.left.gamma.value, with_joints=True)
        if not jobs:
            raise ConfigError(
                "--from: no pair says how the arm stood; give a folder that `calibrate hand-eye` left, whose "
                "taken.yaml has joints_rad for each pair, or a recording with arm/joint_state"
            )
        arm = file.workcell.arm()
        flanges = [
            arm.pose_base_flange(pair.joints_rad).matrix().tolist()
            for pair in taken.pairs
            if pair.joints_rad is not None
        ]
        result = shown_pairs.ask(
            "hand_eye", jobs, flanges=flanges, calibration=known.model_dump(mode="json"), doubt=_doubt(calibration)
        )
        result["settings"] = {"vision": {"camera_correction": result["correction"]}}
        message = {**known.model_dump(mode="json"), "pose_base_camera": result["pose_base_camera"]}
        message = {name: value for name, value in message.items() if name not in ("stamp_ns", "seq", "frame")}
        return FoundCameras(result, message, lambda shown: _show(shown, result), cameras, out)

    wanted = WantedPairs(pattern, files, pairs, by_hand, poses=True, share=share, speed=speed, page=page, record=record)
    calibrate_by_pairs("hand-eye", wanted, cell, as_json, find)


def _cameras(taken: Taken, calibration: Path | None, file: CellFile) -> CameraCalibration:
    if calibration is not None:
        return read_calibration([calibration], FileReading(pose_base_camera=file.workcell.camera.pose_base_camera()))
    if taken.calibration is None:
        raise ConfigError("--calibration: the pictures say nothing of the cameras; give the file of `calibrate stereo`")
    return taken.calibration


def _doubt(calibration: Path | None) -> dict[str, Any] | None:
    """Of a cameras' file that lies where `calibrate stereo` left it, beside what was found."""
    if calibration is None or not (calibration.parent / FOUND).exists():
        return None
    found = read_yaml(calibration.parent / FOUND)
    return doubt_of(found) if "covariance" in found and "model" in found else None


def _show(shown: Console, result: dict[str, Any]) -> None:
    correction = result["correction"]
    rows = []
    for one, value in zip(result["values"][:6], [*correction["turn_rad"], *correction["shift_m"]], strict=True):
        rows.append({**one, "value": value})
    shown.print(values_table("the left camera, in its own frame, against where it was said to be", rows))
    place = ", ".join(f"{value * 1e3:.2f}" for value in result["pose_base_camera"]["position_m"])
    shown.print(
        f"left camera at ({place}) mm in the base\n"
        f"residual {result['rms_px']:.3f} px, {result['rms_mm']:.3f} mm, {result['rms_deg']:.3f}° over "
        f"{result['pairs']} poses\n"
        f"left out {result['held_out_px']:.3f} px, {result['held_out_mm']:.3f} mm, {result['held_out_deg']:.3f}°",
        highlight=False,
    )  # fmt: skip
