"""What becomes of a calibration: a dated file of its own, the cell's file with the new values, the cameras' file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from crosspih_common.config import load_cell
from crosspih_common.config.cell import standing_alone
from crosspih_common.errors import ConfigError
from services.operator.bench.conditions import merged
from services.operator.calibrate.folder import FOUND, now, write_yaml


def write_found(folder: Path, kind: str, cell: str, found: dict[str, Any]) -> Path:
    """`found.yaml` in the calibration's folder: kind, date, cell, and all that was found."""
    path = folder / FOUND
    write_yaml(
        path, {"kind": f"calibration of {kind}", "calibrated_at": now(), "cell": cell, **json.loads(json.dumps(found))}
    )
    return path


def write_cell_file(out: Path, cell: Path, settings: dict[str, Any], kind: str, found: Path | None) -> None:
    """The cell's file with the new values, checked; as `crosspih calibrate refine` writes it, a file of its own.

    Raises ConfigError where `out` is the cell's file itself, or what comes out does not hold.
    """
    if out.resolve() == cell.resolve():
        raise ConfigError(f"--out {out}: is the cell's file itself; name another, and compare the two")
    base = standing_alone(cell, yaml.safe_load(load_cell(cell).text) or {})
    content = merged({name: {} if section is None else section for name, section in base.items()}, settings)
    source = "" if found is None else f"; {found}"
    write_yaml(out, content, f"# {cell.name} with what `crosspih calibrate {kind}` found, {now()}{source}\n")
    load_cell(out)
