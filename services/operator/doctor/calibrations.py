"""Calibrations: whether they exist, their age and temperature, and whether they match the cell's file."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from crosspih_common.config import CameraSection, CellFile
from crosspih_common.modules import data_folder
from crosspih_common.plain_yaml import text_of_file, yaml_of
from crosspih_common.shapes.likeness import is_same_peg
from services.operator.cli.rows import Row, ok, warning, wrong

OLD_DAYS = 30.0
WARMER_K = 5.0
DATED = ("calibrated_at", "date", "made_at")
WARMTH = "temperature_c"
CALIBRATE_FT = "crosspih calibrate ft"
HAVE_NO_CAMERA_OF_THE_CELL = ("simulated", "recorded", "pictures")


def ft_file(cell: CellFile) -> Path:
    """The file in which the force_torque service keeps its calibration: from its section with all settings, below the
    data folder.
    """
    return data_folder() / Path(str(cell.sections["force_torque"]["calibration_file"]).format(cell=cell.workcell.name))


def ft_rows(cell: CellFile, now: datetime, temperature_c: float | None) -> Iterator[Row]:
    """The force/torque sensor's."""
    name, file = "calibration of the sensor", ft_file(cell)
    if not file.exists():
        found = f"{file} is not there: the first assembly calibrates, in some 15 s"
        yield warning(name, found, f"{CALIBRATE_FT}, with the tool free")
        return
    content = _content(file)
    if content is None or "bias" not in content:
        yield wrong(name, f"{file} is no calibration: the service does not use it", f"remove it, then {CALIBRATE_FT}")
        return
    raw = content.get("peg_of_raw")
    made_with = np.eye(6) if raw is None else np.asarray(raw, dtype=float).reshape(6, 6)
    if not np.allclose(made_with, cell.workcell.sensor_mounting().peg_of_raw, rtol=1e-9, atol=1e-9):
        yield warning(name, f"{file} was made with another mounting of the sensor: it is not used", CALIBRATE_FT)
        return
    if content.get("cell") not in (None, cell.workcell.name):
        yield warning(name, f"{file} is of the cell {content.get('cell')}", CALIBRATE_FT)
        return
    if not _of_this_peg(content, cell):
        peg = cell.workcell.peg.outline
        yield warning(name, f"{file} was made with another peg than {peg}: it is not used", CALIBRATE_FT)
        return
    for said in content.get("warnings") or ():
        yield warning(name, str(said), CALIBRATE_FT)
    weight = float(content.get("weight_n", 0.0))
    yield _aged(name, f"{file}: {weight:.2f} N hang on it", content, now, temperature_c, CALIBRATE_FT)


def _of_this_peg(content: dict[str, Any], cell: CellFile) -> bool:
    """Whether the calibration is of this peg, by its contour; older files do not tell."""
    said = content.get("peg")
    try:
        return said is None or is_same_peg(said, cell.workcell.peg.shape())
    except (KeyError, TypeError, ValueError):
        return False


def other_rows(cell: CellFile, now: datetime, temperature_c: float | None, root: Path) -> Iterator[Row]:
    """The newest calibration of each kind that `crosspih calibrate` has written for this cell, below `root` (run/).

    Each is a file found.yaml in a folder of its own, with `kind`, `calibrated_at` and `cell`.
    """
    newest: dict[str, tuple[str, Path, dict[str, Any]]] = {}
    for file in sorted((root / cell.workcell.name / "calibration").glob("*/found.yaml")):
        content = _content(file) or {}
        made = next((str(content[field]) for field in DATED if field in content), "")
        kind = str(content.get("kind", "")).removeprefix("calibration of ")
        if kind and made and made >= newest.get(kind, ("", file, {}))[0]:
            newest[kind] = (made, file, content)
    for kind, (_, file, content) in sorted(newest.items()):
        name = f"calibration of {kind}"
        yield _aged(name, str(file), content, now, temperature_c, f"crosspih calibrate {kind}")


def camera_rows(cell: CellFile, drivers: set[str]) -> Iterator[Row]:
    """Whether the cameras were ever calibrated: the default numbers of the file are those of the simulated cameras."""
    name = "calibration of the cameras"
    section = cell.sections.get("hardware", {})
    camera = (section.get("drivers") or {}).get("camera") or section.get("driver", "simulated")
    if camera == "pictures":
        named = (section.get("pictures") or {}).get("calibration")
        if named and Path(named).is_file():
            yield ok(name, str(named))
        else:
            yield wrong(name, f"hardware.pictures.calibration: {named or 'none'} is not there", "docs/locate.md")
    elif camera in HAVE_NO_CAMERA_OF_THE_CELL:
        yield ok(name, f"the driver {camera} knows it")
    elif isinstance(own := section.get(camera), dict) and own.get("calibration"):
        named = Path(str(own["calibration"]))
        beside = Path(cell.path).resolve().parent / named
        if beside.is_file() or named.is_file():
            yield ok(name, f"hardware.{camera}.calibration: {named}")
        else:
            yield wrong(name, f"hardware.{camera}.calibration: {named} is not there", "docs/locate.md")
    elif camera == "genicam":
        yield warning(
            name, "hardware.genicam names no calibration: cell.camera's numbers are taken",
            "crosspih calibrate stereo and hand-eye",
        )  # fmt: skip
    elif cell.workcell.camera == CameraSection():
        yield warning(
            name, "cell.camera is left at the simulated cameras' numbers",
            "crosspih calibrate stereo and hand-eye, unless the driver tells its own calibration",
        )  # fmt: skip
    else:
        yield ok(name, "cell.camera says where they stand and what their lenses are")


def _content(file: Path) -> dict[str, Any] | None:
    try:
        content = yaml_of(text_of_file(file))
    except (OSError, yaml.YAMLError):
        return None
    return content if isinstance(content, dict) else None


def _aged(name: str, found: str, content: dict[str, Any], now: datetime, temperature_c: float | None, mend: str) -> Row:
    said = next((content[field] for field in DATED if field in content), None)
    try:
        made = said if isinstance(said, datetime) else datetime.fromisoformat(str(said).replace("Z", "+00:00"))
    except ValueError:
        return warning(name, f"{found}; its date {said!r} is none", mend)
    made = made if made.tzinfo is not None else made.replace(tzinfo=timezone.utc)
    days = (now - made).total_seconds() / 86400.0
    warm = content.get(WARMTH)
    age = f"{days:.0f} days old" if days >= 1.0 else f"{days * 24.0:.0f} h old"
    found += f", {age}" if days >= -0.01 else f", {-days:.0f} days ahead of now"
    found += f", at {warm:g} °C" if isinstance(warm, (int, float)) else ", temperature not told"
    if days > OLD_DAYS:
        return warning(name, found, f"{mend}: it is older than {OLD_DAYS:g} days")
    if days < -0.01:
        return warning(name, found, "its date lies ahead: set this machine's clock")
    if temperature_c is not None and isinstance(warm, (int, float)) and abs(temperature_c - warm) > WARMER_K:
        return warning(name, f"{found}; it is {temperature_c:g} °C now", f"{mend}: sensors drift with temperature")
    return ok(name, found)
