"""`crosspih calibrate board`, `stereo` and `hand-eye`."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.config import CellFile, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import CameraCalibration
from services.operator.bench.options import AsJson, told
from services.operator.calibrate.folder import (
    FOUND,
    Taken,
    new_folder,
    now,
    pair_job,
    read_taken,
    read_yaml,
    write_yaml,
)
from services.operator.calibrate.tables import say_missing, values_table
from services.operator.calibrate.taking import VISION, ask, doubt_of, take_by_arm, take_by_hand
from services.operator.calibrate.writing import write_cell_file, write_found
from services.operator.config import BoardSection, OperatorConfig
from services.operator.for_cell import CELL_HELP
from services.operator.locate.calibration_file import Reading, read_calibration
from services.operator.locate.worker import OfflineVision
from services.operator.session import cell_path, using_cell
from services.operator.stack import cell_session

NEEDED = ("hardware",)
BOARD_HELP = "squares across x down:square:marker:dictionary, metres: 9x6:0.02:0.015:DICT_4X4_50. Left out: the cell's."
FROM_HELP = "Offline: a folder that a calibration left, or pictures with left and right in their names."
BoardOption = Annotated[str | None, typer.Option(help=BOARD_HELP)]
FromOption = Annotated[list[Path] | None, typer.Option("--from", help=FROM_HELP)]
CellOption = Annotated[Path | None, typer.Option(help=CELL_HELP)]
ShareOption = Annotated[float, typer.Option(min=0.02, max=1.0, help="Of the arm's own speed limits.")]
HandOption = Annotated[bool, typer.Option("--by-hand", help="You show the board, or move the arm; Enter takes a pair.")]
SpeedOption = Annotated[str | None, typer.Option(help="realtime or max, of a cell that is started for it.")]


def board(
    out: Annotated[Path, typer.Argument(help="A file that ends in .pdf (true size) or .png (300 dpi).")],
    pattern: Annotated[str, typer.Option("--board", help=BOARD_HELP)] = "9x6:0.02:0.015:DICT_4X4_50",
) -> None:
    """Write the ChArUco board to print: at 100 %, on something flat and stiff; check the ruler on it."""
    console = Console()
    with told(console), OfflineVision(VISION) as vision:
        drawn = ask(vision, {"do": "board", "board": pattern, "out": str(out)})
        width, height = (value * 1e3 for value in drawn["size_m"])
        console.print(f"{out}: {pattern}, {width:g} x {height:g} mm of squares", highlight=False)


def _board_of(cell: CellFile, pattern: str | None) -> BoardSection | None:
    section = cell.section("operator", OperatorConfig).board
    if pattern is None:
        return section
    return BoardSection(pattern=pattern) if section is None else section.model_copy(update={"pattern": pattern})


@contextmanager
def _taken(
    console: Console, what: str, cell: CellFile, pattern: str | None, files: list[Path] | None, pairs: int,
    by_hand: bool, share: float, speed: str | None, poses: bool,
) -> Iterator[tuple[Taken, Path, Path, OfflineVision]]:  # fmt: skip
    """The pairs, the folder that they are in, that of what is found, and the vision process that has seen them."""
    with OfflineVision(VISION) as vision:
        if files:
            taken, folder = read_taken(files, pattern)
            yield taken, folder, new_folder(cell.workcell.name, what), vision
            return
        section = _board_of(cell, pattern)
        if section is None:
            raise ConfigError(
                "operator.board: the cell's file names no board; say operator: {board: {pattern: 9x6:0.02:0.015:"
                "DICT_4X4_50, pose_flange_board: {position_m: [...], rotvec_rad: [...]}}}, or --board and --by-hand"
            )
        folder = new_folder(cell.workcell.name, what)
        with cell_session(speed, NEEDED) as (session, _):
            if by_hand:
                taken = take_by_hand(session, vision, section.pattern, folder, console, poses, _asked)
            else:
                taken = take_by_arm(session, vision, section, pairs, folder, console, share, what)
        yield taken, folder, folder, vision


def _asked(text: str) -> bool:
    print(text, file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    return bool(line) and not line.strip().lower().startswith("q")


def stereo(
    pattern: Annotated[str | None, typer.Option("--board", help=BOARD_HELP)] = None,
    files: FromOption = None,
    pairs: Annotated[int, typer.Option(min=5, max=200, help="How many the arm shows.")] = 20,
    by_hand: HandOption = False,
    model: Annotated[
        str | None, typer.Option(help="Size of the distortion, such as 'k1 k2 p1 p2'; by held-out error when left out.")
    ] = None,
    gamma: Annotated[str, typer.Option(help="Of the pictures of --from: linear, or srgb for photos.")] = "linear",
    cameras: Annotated[Path | None, typer.Option(help="Where the camera message goes (docs/locate.md).")] = None,
    cell: CellOption = None,
    share: ShareOption = 0.3,
    speed: SpeedOption = None,
    as_json: AsJson = False,
) -> None:
    """Both lenses and where the right camera stands, by a ChArUco board; written as locate and drivers read it."""
    console = Console(stderr=True)
    with told(console), using_cell(cell):
        file = load_cell(cell_path())
        with _taken(console, "stereo", file, pattern, files, pairs, by_hand, share, speed, False) as found:
            taken, folder, own, vision = found
            jobs = [pair_job(pair, folder, gamma if files else _gamma(taken)) for pair in taken.pairs]
            result = ask(vision, {"do": "stereo", "board": taken.board, "pairs": jobs, "model": model})
        result["board"], result["taken_at"] = taken.board, taken.taken_at.isoformat()
        written = write_found(own, "stereo", file.workcell.name, result)
        message = dict(result["calibration"])
        if taken.calibration is not None:
            message["pose_base_camera"] = taken.calibration.pose_base_camera.model_dump(mode="json")
        target = cameras or own / "cameras.yaml"
        write_yaml(target, message, f"# stereo calibration of {now()}; intervals and residuals: {written}\n")
        if as_json:
            print(json.dumps({**result, "cameras": str(target), "found": str(written)}))
            return
        shown = Console()
        shown.print(values_table(f"{result['pairs']} pairs, {result['corners']} corners", result["values"]))
        for name, left_out in result["held_out_px"].items():
            mark = "  <- taken" if name == result["model"] else ""
            shown.print(f"left out, {name}: {left_out:.4f} px{mark}", highlight=False)
        shown.print(
            f"residual {result['rms_px']:.3f} px, {result['rms_mm']:.4f} mm; left out {result['held_out_mm']:.4f} mm; "
            f"{result['wild']} corners were wild; worst pair {result['worst_pair'] + 1}",
            highlight=False,
        )  # fmt: skip
        say_missing(shown, result)
        shown.print(f"cameras: {target}\nfound:   {written}", highlight=False, soft_wrap=True)


def _gamma(taken: Taken) -> str:
    return "linear" if taken.calibration is None else taken.calibration.left.gamma.value


def hand_eye(
    pattern: Annotated[str | None, typer.Option("--board", help=BOARD_HELP)] = None,
    files: FromOption = None,
    pairs: Annotated[int, typer.Option(min=5, max=200, help="How many the arm shows.")] = 15,
    by_hand: HandOption = False,
    calibration: Annotated[
        Path | None, typer.Option(help="The cameras' file (`calibrate stereo`); left out: what the camera says.")
    ] = None,
    cameras: Annotated[Path | None, typer.Option(help="Where the camera message goes, with pose_base_camera.")] = None,
    out: Annotated[Path | None, typer.Option(help="Where the cell's file goes, with vision.camera_correction.")] = None,
    cell: CellOption = None,
    share: ShareOption = 0.3,
    speed: SpeedOption = None,
    as_json: AsJson = False,
) -> None:
    """Where the cameras stand in the arm's base: the arm shows them a ChArUco board on its flange."""
    console = Console(stderr=True)
    with told(console), using_cell(cell):
        path = Path(cell_path())
        file = load_cell(path)
        with _taken(console, "hand-eye", file, pattern, files, pairs, by_hand, share, speed, True) as found:
            taken, folder, own, vision = found
            known = _cameras(taken, calibration, file)
            shown = [pair for pair in taken.pairs if pair.joints_rad is not None]
            if not shown:
                raise ConfigError(
                    "--from: no pair says how the arm stood; give a folder that `calibrate hand-eye` left, whose "
                    "taken.yaml has joints_rad for each pair"
                )
            arm = file.workcell.arm()
            flanges = [arm.pose_base_flange(pair.joints_rad or ()).matrix().tolist() for pair in shown]
            jobs = [pair_job(pair, folder, known.left.gamma.value) for pair in shown]
            result = ask(vision, {
                "do": "hand_eye", "board": taken.board, "pairs": jobs, "flanges": flanges,
                "calibration": known.model_dump(mode="json"), "doubt": _doubt(calibration),
            })  # fmt: skip
        result["board"], result["taken_at"] = taken.board, taken.taken_at.isoformat()
        result["settings"] = settings = {"vision": {"camera_correction": result["correction"]}}
        written = write_found(own, "hand-eye", file.workcell.name, result)
        message = {**known.model_dump(mode="json"), "pose_base_camera": result["pose_base_camera"]}
        message = {name: value for name, value in message.items() if name not in ("stamp_ns", "seq", "frame")}
        target = cameras or own / "cameras.yaml"
        write_yaml(target, message, f"# hand-eye calibration of {now()}; intervals and residuals: {written}\n")
        if out is not None:
            write_cell_file(out, path, settings, "hand-eye", written)
        if as_json:
            print(json.dumps({**result, "cameras": str(target), "found": str(written)}))
            return
        _show_hand_eye(result, known, target, out, written)


def _cameras(taken: Taken, calibration: Path | None, file: CellFile) -> CameraCalibration:
    if calibration is not None:
        return read_calibration([calibration], Reading(pose_base_camera=file.workcell.camera.pose_base_camera()))
    if taken.calibration is None:
        raise ConfigError("--calibration: the pictures say nothing of the cameras; give the file of `calibrate stereo`")
    return taken.calibration


def _doubt(calibration: Path | None) -> dict[str, Any] | None:
    """Of a cameras' file that lies where `calibrate stereo` left it, beside what was found."""
    if calibration is None or not (calibration.parent / FOUND).exists():
        return None
    found = read_yaml(calibration.parent / FOUND)
    return doubt_of(found) if "covariance" in found and "model" in found else None


def _show_hand_eye(
    result: dict[str, Any], known: CameraCalibration, target: Path, out: Path | None, written: Path
) -> None:
    shown = Console()
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
    say_missing(shown, result)
    shown.print(f"cameras: {target}", highlight=False, soft_wrap=True)
    if out is not None:
        shown.print(f"cell:    {out}", highlight=False, soft_wrap=True)
    shown.print(f"found:   {written}", highlight=False, soft_wrap=True)
