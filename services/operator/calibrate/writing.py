"""The output of a calibration: a dated file of its own, the cell's file with the new values, the cameras' file; and the
printed report.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from crosspih_common.config import CellFile, load_cell
from crosspih_common.config.cell import standing_alone
from crosspih_common.errors import ConfigError
from crosspih_common.plain_yaml import yaml_of
from services.operator.bench.cells.conditions import merged
from services.operator.calibrate.folder import FOUND, now, write_yaml
from services.operator.calibrate.tables import say_missing


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationResult:
    """A finished calibration: `result` for JSON, with `settings` for the cell's file where there are some; `folder` is
    its own. `cameras` holds the path for the camera message, and the message.
    """

    kind: str
    cell: CellFile
    folder: Path
    result: dict[str, Any]
    taken_at: str
    out: Path | None = None
    cameras: tuple[Path, dict[str, Any]] | None = None

    def conclude(self, as_json: bool, show: Callable[[Console], None]) -> None:
        """Write all files, then print the result by `show`, what is missing, and the files. Raises ConfigError."""
        self.result["taken_at"] = self.taken_at
        written = write_found(self.folder, self.kind, self.cell.workcell.name, self.result)
        files = {"found": written}
        if self.cameras is not None:
            target, message = self.cameras
            head = f"# {self.kind} calibration of {now()}; intervals and residuals: {written}\n"
            write_yaml(target, message, head)
            files["cameras"] = target
        if self.out is not None:
            write_cell_file(self.out, self.cell.path, self.result["settings"], self.kind, written)
            files["cell"] = self.out
        if as_json:
            paths = {name: str(path) for name, path in files.items() if name != "cell"}
            print(json.dumps({**self.result, **paths}))
            return
        shown = Console()
        show(shown)
        say_missing(shown, self.result)
        for name, path in sorted(files.items()):
            shown.print(f"{name + ':':<9}{path}", highlight=False, soft_wrap=True)


def write_found(folder: Path, kind: str, cell: str, found: dict[str, Any]) -> Path:
    """`found.yaml` in the calibration's folder: kind, date, cell, and all results."""
    path = folder / FOUND
    write_yaml(
        path, {"kind": f"calibration of {kind}", "calibrated_at": now(), "cell": cell, **json.loads(json.dumps(found))}
    )
    return path


def write_cell_file(out: Path, cell: Path, settings: dict[str, Any], kind: str, found: Path | None) -> None:
    """The cell's file with the new values, checked; as with `crosspih calibrate refine` it is a separate file.

    Raises ConfigError where `out` is the cell's file itself, or the new content is not valid.
    """
    if out.resolve() == cell.resolve():
        raise ConfigError(f"--out {out}: is the cell's file itself; name another, and compare the two")
    base = standing_alone(cell, yaml_of(load_cell(cell).text) or {})
    content = merged({name: {} if section is None else section for name, section in base.items()}, settings)
    source = "" if found is None else f"; {found}"
    write_yaml(out, content, f"# {cell.name} with what `crosspih calibrate {kind}` found, {now()}{source}\n")
    load_cell(out)
