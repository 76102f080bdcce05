"""`crosspih calibrate board`, `stereo` and `hand-eye`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.config import CellFile, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import CameraCalibration
from services.operator.assembly.stack import cell_session
from services.operator.bench.options import AsJson, errors_shown
from services.operator.calibrate.folder import FOUND, Taken, new_folder, pair_job, read_taken, read_yaml
from services.operator.calibrate.options import (
    CellOption,
    RecordOption,
    ShareOption,
    SpeedOption,
    needed,
    recorded,
    say_notes,
)
from services.operator.calibrate.page import LivePage
from services.operator.calibrate.recorded import is_recording
from services.operator.calibrate.recorded_pictures import taken_of
from services.operator.calibrate.tables import values_table
from services.operator.calibrate.taking import VISION, ask, doubt_of, take_by_arm, take_by_hand
from services.operator.calibrate.writing import CalibrationResult
from services.operator.cell.which_cell import cell_path, using_cell
from services.operator.config import BoardSection, OperatorConfig
from services.operator.locate.calibration_file import FileReading, read_calibration
from services.operator.locate.worker import OfflineVision

NEEDED = ("hardware",)
STEREO, HAND_EYE, CAMERAS = "stereo", "hand-eye", "cameras.yaml"
BOARD_HELP = "squares across x down:square:marker:dictionary, metres: 9x6:0.02:0.015:DICT_4X4_50. Left out: the cell's."
FROM_HELP = (
    "Offline: a folder that a calibration left, pictures with left and right in their names, or a recording (.mcap)."
)
BoardOption = Annotated[str | None, typer.Option("--board", help=BOARD_HELP)]
FromOption = Annotated[list[Path] | None, typer.Option("--from", help=FROM_HELP)]
HandOption = Annotated[bool, typer.Option("--by-hand", help="You show the board, or move the arm; Enter takes a pair.")]
PageOption = Annotated[bool, typer.Option("--page/--no-page", help="Live pictures for a browser on this machine.")]


@dataclass(frozen=True, slots=True)
class TakingManner:
    """How pairs are taken."""

    pairs: int
    by_hand: bool
    share: float
    speed: str | None
    page: bool
    record: bool


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


def _board_of(cell: CellFile, pattern: str | None) -> BoardSection | None:
    section = cell.section("operator", OperatorConfig).board
    if pattern is None:
        return section
    return BoardSection(pattern=pattern) if section is None else section.model_copy(update={"pattern": pattern})


@dataclass(slots=True)
class _Pairs:
    """What was taken: the folder that the pictures are in, that of what is found, and the vision process that has seen
    them."""

    taken: Taken
    pictures: Path
    own: Path
    vision: OfflineVision

    def jobs(self, gamma: str, with_joints: bool = False) -> list[dict[str, Any]]:
        """For the vision process; `with_joints`: those alone that say how the arm stood."""
        pairs = [pair for pair in self.taken.pairs if pair.joints_rad is not None or not with_joints]
        return [pair_job(pair, self.pictures, gamma) for pair in pairs]


@contextmanager
def _taken(
    console: Console, what: str, cell: CellFile, pattern: str | None, files: list[Path] | None, manner: TakingManner
) -> Iterator[_Pairs]:
    own = new_folder(cell.workcell.name, what)
    with OfflineVision(VISION) as vision:
        if files and any(map(is_recording, files)):
            if len(files) > 1:
                raise ConfigError("--from: give one recording (.mcap), or pictures, and not both")
            taken, notes = taken_of(files[0], own, pattern, cell.workcell)
            say_notes(console, notes)
            yield _Pairs(taken, own, own, vision)
            return
        if files:
            taken, pictures = read_taken(files, pattern)
            yield _Pairs(taken, pictures, own, vision)
            return
        section = _board_of(cell, pattern)
        if section is None:
            raise ConfigError(
                "operator.board: the cell's file names no board; say operator: {board: {pattern: 9x6:0.02:0.015:"
                "DICT_4X4_50, pose_flange_board: {position_m: [...], rotvec_rad: [...]}}}, or --board and --by-hand"
            )
        with ExitStack() as stack:
            page = None
            if manner.page:
                page = stack.enter_context(LivePage(own, f"crosspih calibrate {what}, {cell.workcell.name}"))
                console.print(f"live pictures: {page.address}", highlight=False)
            session, _ = stack.enter_context(cell_session(manner.speed, needed(NEEDED, manner.record)))
            with recorded(session, what, manner.record, console):
                if manner.by_hand:
                    taken = take_by_hand(session, vision, section.pattern, own, console, what == HAND_EYE, _asked, page)
                else:
                    taken = take_by_arm(
                        session, vision, section, manner.pairs, own, console, manner.share, what, page=page
                    )
            if page is not None:
                page.say(f"{len(taken.pairs)} pairs are taken; reckoning")
            yield _Pairs(taken, own, own, vision)


def _asked(text: str) -> bool:
    print(text, file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    return bool(line) and not line.strip().lower().startswith("q")


def stereo(
    pattern: BoardOption = None,
    files: FromOption = None,
    pairs: Annotated[int, typer.Option(min=5, max=200, help="How many the arm shows.")] = 20,
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
    console = Console(stderr=True)
    with errors_shown(console), using_cell(cell):
        file = load_cell(cell_path())
        with _taken(
            console, STEREO, file, pattern, files, TakingManner(pairs, by_hand, share, speed, page, record)
        ) as found:
            taken = found.taken
            jobs = found.jobs(gamma or _gamma(taken))
            result = ask(found.vision, {"do": "stereo", "board": taken.board, "pairs": jobs, "model": model})
        result["board"] = taken.board
        message = dict(result["calibration"])
        if taken.calibration is not None:
            message["pose_base_camera"] = taken.calibration.pose_base_camera.model_dump(mode="json")

        def show(shown: Console) -> None:
            shown.print(values_table(f"{result['pairs']} pairs, {result['corners']} corners", result["values"]))
            for name, left_out in result["held_out_px"].items():
                mark = "  <- taken" if name == result["model"] else ""
                shown.print(f"left out, {name}: {left_out:.4f} px{mark}", highlight=False)
            shown.print(
                f"residual {result['rms_px']:.3f} px, {result['rms_mm']:.4f} mm; left out {result['held_out_mm']:.4f} "
                f"mm; {result['wild']} corners were wild; worst pair {result['worst_pair'] + 1}",
                highlight=False,
            )  # fmt: skip

        target = cameras or found.own / CAMERAS
        CalibrationResult(
            STEREO, file, found.own, result, taken.taken_at.isoformat(), cameras=(target, message)
        ).conclude(as_json, show)


def _gamma(taken: Taken) -> str:
    return "linear" if taken.calibration is None else taken.calibration.left.gamma.value


def hand_eye(
    pattern: BoardOption = None,
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
    page: PageOption = True,
    record: RecordOption = False,
    as_json: AsJson = False,
) -> None:
    """Where the cameras stand in the arm's base: the arm shows them a ChArUco board on its flange."""
    console = Console(stderr=True)
    with errors_shown(console), using_cell(cell):
        file = load_cell(cell_path())
        with _taken(
            console, HAND_EYE, file, pattern, files, TakingManner(pairs, by_hand, share, speed, page, record)
        ) as found:
            taken = found.taken
            known = _cameras(taken, calibration, file)
            jobs = found.jobs(known.left.gamma.value, with_joints=True)
            if not jobs:
                raise ConfigError(
                    "--from: no pair says how the arm stood; give a folder that `calibrate hand-eye` left, whose "
                    "taken.yaml has joints_rad for each pair, or a recording with arm/joint_state"
                )
            arm = file.workcell.arm()
            result = ask(found.vision, {
                "do": "hand_eye", "board": taken.board, "pairs": jobs,
                "flanges": [
                    arm.pose_base_flange(pair.joints_rad).matrix().tolist()
                    for pair in taken.pairs if pair.joints_rad is not None
                ],
                "calibration": known.model_dump(mode="json"), "doubt": _doubt(calibration),
            })  # fmt: skip
        result["board"] = taken.board
        result["settings"] = {"vision": {"camera_correction": result["correction"]}}
        message = {**known.model_dump(mode="json"), "pose_base_camera": result["pose_base_camera"]}
        message = {name: value for name, value in message.items() if name not in ("stamp_ns", "seq", "frame")}
        target = cameras or found.own / CAMERAS
        CalibrationResult(
            HAND_EYE, file, found.own, result, taken.taken_at.isoformat(), out, (target, message)
        ).conclude(as_json, lambda shown: _show_hand_eye(shown, result))


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


def _show_hand_eye(shown: Console, result: dict[str, Any]) -> None:
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
