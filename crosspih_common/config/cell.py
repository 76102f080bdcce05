"""Read a cell's file: the `cell` section for all, and one section a service that the service itself defines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import ValidationError

from crosspih_common.config.arm import with_urdf_beside
from crosspih_common.config.force_torque import with_correction_moved
from crosspih_common.config.section import Section
from crosspih_common.config.spelling import did_you_mean, fields_beside, words_of
from crosspih_common.config.surroundings import with_mesh_files_beside
from crosspih_common.config.workcell import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.plain_yaml import MAX_BYTES, text_of_file, yaml_of
from crosspih_common.shapes.importing import FILE_SUFFIXES

SERVICES = (
    "router",
    "hardware",
    "vision",
    "force_torque",
    "inference",
    "planning",
    "recorder",
    "operator",
    "ros2",
    "viewer",
)

SectionT = TypeVar("SectionT", bound=Section)


def _explain(path: Path, where: str, error: ValidationError, model: type[Section]) -> ConfigError:
    lines, fields, mends = [], [], []
    for problem in error.errors():
        fields.append(".".join([where, *(str(part) for part in problem["loc"])]))
        if problem["type"] == "extra_forbidden":
            meant = did_you_mean(str(problem["loc"][-1]), fields_beside(model, problem["loc"]))
            mends.append("remove it or mend its spelling" + (f": {meant}" if meant else ""))
            lines.append(f"{fields[-1]}: no such setting; {mends[-1]}")
        else:
            expected = str((problem.get("ctx") or {}).get("expected", ""))
            mends.append(did_you_mean(str(problem["input"]), words_of(expected)))
            said = f"{fields[-1]}: {problem['msg'].removeprefix('Value error, ')} (got {problem['input']!r})"
            lines.append(said + (f"; {mends[-1]}" if mends[-1] else ""))
    return ConfigError(f"{path}: " + "; ".join(lines), field=fields[0], mend=mends[0])


@dataclass(frozen=True, slots=True)
class CellFile:
    """A cell's file: the shared section, and the raw sections that services validate themselves."""

    path: Path
    text: str
    workcell: Workcell
    sections: dict[str, dict[str, Any]]

    def section(self, service: str, model: type[SectionT]) -> SectionT:
        """A service's own section as its own model; the defaults where the file has none. Raises ConfigError."""
        try:
            return model.model_validate(self.sections.get(service, {}))
        except ValidationError as error:
            raise _explain(self.path, service, error, model) from None


def _outline_beside(path: Path, cell: dict[str, Any]) -> dict[str, Any]:
    """The cell's section; a relative path of the peg's drawing is resolved from the folder of the cell's file."""
    peg = cell.get("peg")
    if not isinstance(peg, dict):
        return cell
    outline = peg.get("outline")
    if not isinstance(outline, str) or Path(outline).suffix.lower() not in FILE_SUFFIXES:
        return cell
    return {**cell, "peg": {**peg, "outline": str(path.parent / outline)}}


def with_files_beside(path: Path, cell: dict[str, Any]) -> dict[str, Any]:
    """The raw section `cell` of the file at `path`; relative paths in it are resolved from the folder of that file."""
    return with_mesh_files_beside(path, with_urdf_beside(path, _outline_beside(path, cell)))


def standing_alone(path: Path, content: dict[str, Any]) -> dict[str, Any]:
    """A cell file's content that can be written to any folder: the files that it names get absolute paths."""
    if not isinstance(cell := content.get("cell"), dict):
        return content
    return {**content, "cell": with_files_beside(path.resolve(), cell)}


def content_alone(cell: CellFile) -> dict[str, Any]:
    """The content of a loaded cell file, with absolute paths; empty sections become empty mappings."""
    content = {name: {} if section is None else section for name, section in (yaml_of(cell.text) or {}).items()}
    return standing_alone(cell.path, content)


def load_cell(path: str | Path) -> CellFile:
    """Read and check a cell's file. Raises ConfigError that names the file, the field and how to correct it."""
    path = Path(path)
    try:
        text = text_of_file(path, MAX_BYTES)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); name a cell file with CROSSPIH_CELL") from None
    return cell_of_text(path, text)


def cell_of_text(path: Path, text: str) -> CellFile:
    """Check the text of a cell's file; relative paths in it are resolved from the folder of `path`.

    Raises ConfigError that names `path`, the field and how to correct it.
    """
    try:
        content = yaml_of(text) or {}
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: is not YAML: {error}") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: wants a mapping of sections, got {type(content).__name__}")
    known = ("cell", *SERVICES)
    for name, section in content.items():
        if name not in known:
            meant = did_you_mean(str(name), known)
            mend = f"want one of {', '.join(known)}" + (f": {meant}" if meant else "")
            raise ConfigError(f"{path}: {name}: no such section; {mend}", field=str(name), mend=mend)
        if section is not None and not isinstance(section, dict):
            raise ConfigError(f"{path}: {name}: wants a mapping, got {type(section).__name__}")
    try:
        content = with_correction_moved(content)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None
    try:
        workcell = Workcell.model_validate(with_files_beside(path, content.get("cell") or {}))
    except ValidationError as error:
        raise _explain(path, "cell", error, Workcell) from None
    return CellFile(path, text, workcell, {name: content.get(name) or {} for name in SERVICES})
