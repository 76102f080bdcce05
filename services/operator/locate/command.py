"""`crosspih locate`."""

from __future__ import annotations

import json
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from crosspih_common.config import load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.messages import Gamma, LocateMethod
from services.operator.cell.which_cell import cell_path, using_cell
from services.operator.cli.failure import Failed, failure_of
from services.operator.cli.for_cell import CELL_HELP
from services.operator.cli.options import AsJson
from services.operator.locate.calibration_file import FileReading, read_calibration
from services.operator.locate.reading import CameraFileError
from services.operator.locate.showing import show
from services.operator.locate.worker import BadInput, OfflineVision, VisionLost

BAD_INPUT, REFUSED = 2, 3
FIELDS = ("located", "pose_base_hole", "covariance", "refusal", "time_s", "quality", "warnings")


class Unit(str, Enum):
    """The length of 1 in a ROS or OpenCV file."""

    M = "m"
    CM = "cm"
    MM = "mm"

    @property
    def metres(self) -> float:
        """In metres."""
        return {"m": 1.0, "cm": 1e-2, "mm": 1e-3}[self.value]


def cell_file() -> str:
    """The cell's file; where none is named and none is in this folder, the default cell of the package."""
    return cell_path()


def files_of(given: str, field: str) -> list[Path]:
    """One file, or several with commas between. Raises BadInput naming the field."""
    named = [given] if Path(given).exists() else given.split(",")
    files = [Path(name) for name in named if name]
    if not files:
        raise BadInput(f"{field}: {given!r} names no file")
    for path in files:
        if not path.is_file():
            what = "is no file" if path.exists() else "does not exist"
            raise BadInput(
                f"{field}: {path} {what}; give a picture, or several with commas between, one for each light"
            )
    return files


def size_px(path: Path, field: str) -> tuple[int, int]:
    """(width, height) of a picture, from its header. Raises BadInput."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as picture:
            return picture.size
    except (UnidentifiedImageError, OSError):
        raise BadInput(f"{field}: {path} is not a picture that can be read; give PNG, TIFF, JPEG or BMP") from None


def locate(
    left: Annotated[str, typer.Argument(help="The left camera's picture; several lights: a.png,b.png.")],
    right: Annotated[str, typer.Argument(help="The right camera's, as many and in the same order.")],
    calibration: Annotated[
        list[str],
        typer.Option(
            help="Camera message (YAML, JSON), ROS camera_info or OpenCV's stereo file; of two files (left and right, "
            "or intrinsics and extrinsics) give the option twice, or a comma between.",
        ),
    ],
    cell: Annotated[Path | None, typer.Option(help=CELL_HELP)] = None,
    as_json: AsJson = False,
    annotated: Annotated[
        Path | None, typer.Option(help="Folder for left.png and right.png with what was seen; it is made.")
    ] = None,
    gamma: Annotated[
        Gamma | None, typer.Option(help="Of both cameras, instead of that in the calibration; srgb for photos.")
    ] = None,
    method: Annotated[LocateMethod, typer.Option(help="rim: six degrees of freedom; paper: the position alone.")] = (
        LocateMethod.RIM
    ),
    rectified: Annotated[
        bool, typer.Option("--rectified", help="The pictures are rectified: ROS or OpenCV's P describes them.")
    ] = False,
    unit: Annotated[Unit, typer.Option(help="The unit of an OpenCV or ROS file's lengths.")] = Unit.M,
) -> None:
    """Where the hole is in a pair of pictures, with no stack running.

    Status 0: located; 3: refused, with the reason; 2: an input that cannot be used.
    """
    console = Console(stderr=True)
    try:
        with using_cell(cell):
            answer, place = _asked(console, left, right, calibration, annotated, gamma, method, rectified, unit)
    except (BadInput, CameraFileError, ConfigError) as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise Failed(failure_of(error), BAD_INPUT) from None
    except VisionLost as error:
        console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
        raise Failed(failure_of(error)) from None
    if as_json:
        print(json.dumps({name: answer[name] for name in FIELDS}))
    else:
        show(Console(), answer, annotated, place)
    if not answer["located"]:
        raise typer.Exit(REFUSED)


def _asked(
    console: Console, left: str, right: str, calibration: list[str], annotated: Path | None, gamma: Gamma | None,
    method: LocateMethod, rectified: bool, unit: Unit,
) -> tuple[dict[str, object], str]:  # fmt: skip
    lefts, rights = files_of(left, "left"), files_of(right, "right")
    cell = cell_file()
    workcell = load_cell(cell).workcell
    files = [Path(name) for given in calibration for name in ([given] if Path(given).exists() else given.split(","))]
    camera = read_calibration(
        files,
        FileReading(
            pose_base_camera=workcell.camera.pose_base_camera(), gamma=gamma, unit_m=unit.metres, rectified=rectified,
            sizes=lambda: (size_px(lefts[0], "left"), size_px(rights[0], "right")),
        ),
    )  # fmt: skip
    photos = [path for path in (*lefts, *rights) if path.suffix.lower() in (".jpg", ".jpeg")]
    if photos and gamma is None and Gamma.SRGB not in (camera.left.gamma, camera.right.gamma):
        console.print(
            f"{photos[0]} is a JPEG, which most cameras write with a gamma, and the calibration says linear: try "
            "--gamma srgb",
            style="yellow", markup=False, highlight=False, soft_wrap=True,
        )  # fmt: skip
    job = {
        "left": [str(path) for path in lefts],
        "right": [str(path) for path in rights],
        "calibration": camera.model_dump(mode="json"),
        "cell": cell,
        "annotated": None if annotated is None else str(annotated),
        "method": method.value,
        "rectified": rectified,
    }
    with OfflineVision() as vision:
        answer = vision.ask(job)
    at = ", ".join(f"{value * 1e3:.1f}" for value in camera.pose_base_camera.position_m)
    return answer, f"left camera at ({at}) mm in the base"
