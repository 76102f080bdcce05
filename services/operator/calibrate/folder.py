"""A calibration's own folder with its inputs and results, so that it can be repeated offline (`--from`)."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import AwareDatetime, BaseModel, ConfigDict, ValidationError

from crosspih_common.calibration.presses import Pressed
from crosspih_common.errors import ConfigError
from crosspih_common.messages import CameraCalibration
from crosspih_common.messages.base import Joints
from crosspih_common.messages.images import Image
from crosspih_common.plain_yaml import text_of_file, yaml_of
from deploy.launcher.state import default_run_root

TAKEN, PRESSED, FOUND = "taken.yaml", "pressed.yaml", "found.yaml"
PICTURES = (".png", ".pgm", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")


class TakenPair(BaseModel):
    """One pair of pictures; with joints where an arm showed the board (`pose_base_flange` then follows from its
    kinematics).
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    left: str
    right: str
    encodings: tuple[str | None, str | None] = (None, None)
    joints_rad: Joints | None = None


class Taken(BaseModel):
    """The whole content of a folder with pictures."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    taken_at: AwareDatetime
    cell: str = ""
    board: str
    calibration: CameraCalibration | None = None
    pairs: tuple[TakenPair, ...]


def now() -> str:
    """The wall clock's time with its zone, ISO 8601, to the second."""
    return datetime.now(timezone.utc).astimezone().isoformat(timespec="seconds")


def new_folder(cell: str, what: str) -> Path:
    """Create run/<cell>/calibration/<what>-<date>."""
    stamp = datetime.now(timezone.utc).astimezone().strftime("%Y%m%d-%H%M%S")
    root = default_run_root() / cell / "calibration"
    folder, number = root / f"{what}-{stamp}", 1
    while folder.exists():
        number += 1
        folder = root / f"{what}-{stamp}-{number}"
    folder.mkdir(parents=True)
    return folder


def named_folder(cell: str, given: Path) -> Path:
    """The folder that `--from` names: a path, or by its first word the newest folder of an earlier calibration
    (`mount`).
    """
    if given.exists() or len(given.parts) != 1:
        return given
    # their names hold their dates; a folder that was made offline holds no inputs
    folders = sorted((default_run_root() / cell / "calibration").glob(f"{given.name}-*"))
    taken = [folder for folder in folders if (folder / PRESSED).exists() or (folder / TAKEN).exists()]
    return taken[-1] if taken else given


def write_picture(image: Image, path: Path) -> None:
    """Write as PGM or PPM: the values as the camera sent them."""
    pixels = image.pixels
    if image.encoding == "bgr8":
        pixels = pixels[:, :, ::-1]
    kind = "P6" if pixels.ndim == 3 else "P5"
    wide = pixels.dtype == np.uint16
    header = f"{kind}\n{pixels.shape[1]} {pixels.shape[0]}\n{65535 if wide else 255}\n".encode("ascii")
    path.write_bytes(header + pixels.astype(">u2" if wide else "u1").tobytes())


def encoding_of(image: Image) -> str | None:
    """The encoding to note beside the file, only for a Bayer pattern; the file itself shows every other encoding."""
    return image.encoding if image.encoding.startswith("bayer_") else None


def write_pair(folder: Path, number: int, left: Image, right: Image, joints_rad: tuple[float, ...] | None) -> TakenPair:
    """As files pair-<number>-left and -right."""
    names = []
    for side, image in (("left", left), ("right", right)):
        names.append(f"pair-{number:03d}-{side}" + (".ppm" if image.pixels.ndim == 3 else ".pgm"))
        write_picture(image, folder / names[-1])
    return TakenPair(
        left=names[0], right=names[1], encodings=(encoding_of(left), encoding_of(right)), joints_rad=joints_rad
    )


def write_yaml(path: Path, content: dict[str, Any], header: str = "") -> None:
    """Write the file completely or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(header + yaml.safe_dump(content, sort_keys=False, width=110), encoding="utf-8")
    partial.replace(path)


def read_yaml(path: Path) -> dict[str, Any]:
    """Raises ConfigError."""
    try:
        content = yaml_of(text_of_file(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: is not YAML: {error}") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: wants a mapping, got {type(content).__name__}")
    return content


def save_taken(folder: Path, taken: Taken) -> None:
    """Write the list of pairs beside their pictures."""
    write_yaml(folder / TAKEN, taken.model_dump(mode="json"))


def read_taken(paths: list[Path], board: str | None) -> tuple[Taken, Path]:
    """Read the folder of an earlier calibration, or a folder of pictures: those with `left` and `right` in their names,
    paired in the order of the names. Raises ConfigError that says what is missing.
    """
    if len(paths) == 1 and paths[0].is_dir() and (paths[0] / TAKEN).exists():
        try:
            taken = Taken.model_validate(read_yaml(paths[0] / TAKEN))
        except ValidationError as error:
            raise _fault(paths[0] / TAKEN, error) from None
        return taken if board is None else taken.model_copy(update={"board": board}), paths[0]
    files = [
        file
        for path in paths
        for file in (sorted(path.iterdir()) if path.is_dir() else [path])
        if file.suffix.lower() in PICTURES
    ]
    sides = [sorted(file for file in files if name in file.name.lower()) for name in ("left", "right")]
    if not sides[0] or len(sides[0]) != len(sides[1]):
        raise ConfigError(
            f"--from: {len(sides[0])} pictures have `left` in their names and {len(sides[1])} have `right`; give as "
            "many of each, in the same order, or a folder that a calibration has left"
        )
    if board is None:
        raise ConfigError("--board: say which board the pictures show, such as 9x6:0.02:0.015:DICT_4X4_50")
    pairs = tuple(
        TakenPair(left=str(left.resolve()), right=str(right.resolve())) for left, right in zip(*sides, strict=True)
    )
    return Taken.model_validate({"taken_at": now(), "board": board, "pairs": pairs}), Path()


def read_pressed(given: Path) -> Pressed:
    """Read the folder of an earlier calibration by pushes, or its file. Raises ConfigError."""
    path = given / PRESSED if given.is_dir() else given
    try:
        return Pressed.model_validate(read_yaml(path))
    except ValidationError as error:
        raise _fault(path, error) from None


def _fault(path: Path, error: ValidationError) -> ConfigError:
    fault = error.errors()[0]
    return ConfigError(f"{path}: {'.'.join(map(str, fault['loc']))}: {fault['msg']}")


def pair_job(pair: TakenPair, folder: Path, gamma: str) -> dict[str, Any]:
    """A pair in the form that the vision process takes."""
    return {
        "left": str(folder / pair.left), "right": str(folder / pair.right), "encodings": list(pair.encodings),
        "gamma": gamma,
    }  # fmt: skip
