"""A cell like the current one, but with another peg and its hole: for a stack that a command starts for itself."""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from crosspih_common.config import CellFile, load_cell
from crosspih_common.config.cell import content_alone
from crosspih_common.config.drawing import PegDrawing, peg_section
from crosspih_common.errors import BusUnreachable, ConfigError
from services.operator.assembly.session import Session
from services.operator.cell.which_cell import cell_path, endpoint

CALIBRATION_FILE = "run/{cell}/ft-calibration.yaml"


def content_with_peg(cell: CellFile, peg: str) -> dict[str, Any] | None:
    """The cell's file, as a mapping, with a peg by its name or its drawing's file; None when it is the cell's own.

    Another peg has another weight, so its calibration is kept in a separate file. For a peg from a drawing its contour
    identifies that file, whatever the drawing is called. Raises ConfigError.
    """
    section = peg_section(peg)
    own = cell.workcell.peg
    if section == {"outline": own.outline} or PegDrawing.model_validate(section) == own:
        return None
    content = content_alone(cell)
    content["cell"] = {**content.get("cell", {}), "peg": section}
    force_torque = dict(content.get("force_torque", {}))
    kept = Path(str(force_torque.get("calibration_file", CALIBRATION_FILE)))
    force_torque["calibration_file"] = str(kept.with_stem(f"{kept.stem}-{_calibrated_as(section)}"))
    return {**content, "force_torque": force_torque}


def _calibrated_as(section: dict[str, Any]) -> str:
    """The part of a calibration file's name that identifies the peg."""
    corners = section.get("corners_m")
    if corners is None:
        return str(section["outline"])
    microns = [[round(value * 1e6) for value in corner] for corner in corners]
    return f"drawing-{hashlib.sha256(json.dumps(microns).encode()).hexdigest()[:12]}"


@contextmanager
def cell_with_peg(peg: str | None) -> Iterator[None]:
    """For the length of the block CROSSPIH_CELL names a cell with that peg; with None nothing is changed.

    Raises ConfigError when there is no such peg, and when a stack with another one is running.
    """
    if peg is None:
        yield
        return
    cell = load_cell(cell_path())
    content = content_with_peg(cell, peg)
    if content is None:
        yield
        return
    if _stack_is_running():
        raise ConfigError(
            f"--peg {peg}: the stack at {endpoint()} runs with the peg {cell.workcell.peg.outline}; stop it with "
            f"`crosspih down`, or leave --peg out"
        )
    before = os.environ.get("CROSSPIH_CELL")
    with tempfile.TemporaryDirectory(prefix="crosspih-peg-") as folder:
        path = Path(folder) / "cell.yaml"
        path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        load_cell(path)  # report errors of the file here once, not by five services
        os.environ["CROSSPIH_CELL"] = str(path)
        try:
            yield
        finally:
            if before is None:
                del os.environ["CROSSPIH_CELL"]
            else:
                os.environ["CROSSPIH_CELL"] = before


def _stack_is_running() -> bool:
    try:
        Session(connect_timeout_s=1.0).bus.close()
    except BusUnreachable:
        return False
    return True
