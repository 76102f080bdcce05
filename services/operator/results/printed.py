"""The output of each command, kept beside the store so that a stopped run continues where it was."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError


class Printed(BaseModel):
    """The output of one entry.

    code, cell: of the measurement; shown_by: the operator's own code, which makes the tables. elapsed_s: of the run
    that printed it. taken: number of results from the stores, taken_s the time in which those were measured, first and
    last the dates of that; made: number of results that it measured itself. at: UTC, ISO 8601.
    """

    model_config = ConfigDict(frozen=True)

    name: str
    command: str
    code: str
    cores: int
    status: int
    elapsed_s: float
    text: str
    cell: str = ""
    shown_by: str = ""
    at: str = ""
    taken: int = 0
    made: int = 0
    taken_s: float | None = None
    first: str = ""
    last: str = ""

    def stands_for(self, command: str, code: str, cell: str) -> bool:
        """Whether this is the output of that command with this code in this cell."""
        return (self.command, self.code, self.cell, self.status) == (command, code, cell, 0)


class PrintedFolder:
    """A JSON file per entry."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def _path(self, name: str) -> Path:
        return self._folder / f"{name}.json"

    def get(self, name: str) -> Printed | None:
        """The last output of the entry, if it can be read."""
        try:
            return Printed.model_validate_json(self._path(name).read_text(encoding="utf-8"))
        except (OSError, ValidationError):
            return None

    def put(self, printed: Printed) -> None:
        """Save it completely or not at all."""
        self._folder.mkdir(parents=True, exist_ok=True)
        scratch = self._path(printed.name).with_suffix(".new")
        scratch.write_text(printed.model_dump_json(indent=1), encoding="utf-8")
        scratch.replace(self._path(printed.name))
