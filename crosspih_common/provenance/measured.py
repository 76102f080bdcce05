"""Records, in a file, which results a command took from its stores and which it measured itself.

`crosspih results` names the file by CROSSPIH_MEASURED. Without it a page would show the time of printing stored results
as the time of measuring them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

MEASURED_VARIABLE = "CROSSPIH_MEASURED"


class Measured(BaseModel):
    """Results of one or several stores: `taken` were known from before, `made` were measured in this run.

    taken_s: the total measuring time of the results taken over, s, None if a store does not know it. first, last: when
    they were measured, UTC as ISO 8601, empty if nothing was taken over or the times are unknown.
    """

    model_config = ConfigDict(frozen=True)

    taken: int = 0
    made: int = 0
    taken_s: float | None = 0.0
    first: str = ""
    last: str = ""


def record_measured(measured: Measured) -> None:
    """Add a line to the file that CROSSPIH_MEASURED names; does nothing if it is not set."""
    path = os.environ.get(MEASURED_VARIABLE)
    if path and measured.taken + measured.made:
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(measured.model_dump_json() + "\n")


def _together(every: Iterable[Measured]) -> Measured:
    rows = list(every)
    known = [row.taken_s for row in rows if row.taken and row.taken_s is not None]
    unknown = any(row.taken and row.taken_s is None for row in rows)
    return Measured(
        taken=sum(row.taken for row in rows),
        made=sum(row.made for row in rows),
        taken_s=None if unknown else sum(known),
        first=min((row.first for row in rows if row.first), default=""),
        last=max((row.last for row in rows if row.last), default=""),
    )


def measured_in(path: Path) -> Measured:
    """All lines that a command wrote to the file; empty if there is no file."""
    try:
        return _together(Measured.model_validate_json(line) for line in path.read_text(encoding="utf-8").splitlines())
    except (OSError, ValidationError):
        return Measured()
