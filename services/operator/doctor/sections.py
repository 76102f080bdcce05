"""The sections of the cell's file, each read by its own service: `python -m services.NAME --check-config`."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from crosspih_common.config import CellFile
from crosspih_common.errors import ConfigError
from services.operator.cli.rows import Row, ok, warning, wrong
from services.operator.config import OperatorConfig
from services.operator.other_services.beside import ModuleOutput, run_module

NEEDED = ("hardware", "vision", "force_torque", "inference", "planning", "recorder")
# not needed for an assembly: what is missing without them
OPTIONAL = {"ros2": "the cell does not appear in ROS 2", "viewer": "there is no page in the browser"}
MEND = "mend what it names, or leave it out for its default"


@dataclass(frozen=True)
class ReadSections:
    """The sections as the services read them: `settings` of those that are valid, with defaults filled in; the others
    are missing.
    """

    rows: tuple[Row, ...] = ()
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)

    def filled(self, cell: CellFile) -> CellFile:
        """The cell's file, its sections with all their settings."""
        return replace(cell, sections={**cell.sections, **self.settings})


def read_sections(path: Path, cell: CellFile) -> ReadSections:
    """Every section of the file at `path`, in separate processes, as many at once as there are cores."""
    names = (*NEEDED, *(name for name in OPTIONAL if cell.sections[name]))
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        said = list(pool.map(lambda name: run_module(f"services.{name}", "--check-config", "--cell", str(path)), names))
    rows: list[Row] = []
    settings: dict[str, dict[str, Any]] = {}
    for name, answer in zip(names, said, strict=True):
        if isinstance(answer.value, dict) and answer.value.get("ok"):
            settings[name] = answer.value["settings"]
        else:
            rows.append(_refused(name, answer))
    try:
        cell.section("operator", OperatorConfig)
    except ConfigError as error:
        rows.append(warning("section operator", f"{error}: crosspih calibrate refuses it", MEND))
    if cell.sections["router"]:
        found = f"router: {', '.join(cell.sections['router'])}: the router reads no settings"
        rows.append(warning("section router", found, "remove the section; its address is CROSSPIH_ENDPOINT"))
    if settings:
        rows.insert(0, ok("sections", f"{', '.join(settings)}: each service reads its own"))
    return ReadSections(tuple(rows), settings)


def _refused(name: str, answer: ModuleOutput) -> Row:
    where = f"section {name}"
    if isinstance(answer.value, dict) and "wrong" in answer.value:
        found, mend = str(answer.value["wrong"]), MEND
    else:
        extra = f"pip install 'crosspih[{name}]'"
        found, mend = f"the service does not start: {answer.words}", f"mend what it names; {extra} for what it needs"
    if name in OPTIONAL:
        return warning(where, f"{found}: {OPTIONAL[name]}", mend)
    return wrong(where, found, mend)
