"""What a command took over from its stores, and what it measured: told to whoever started it, through a file.

`crosspih results` names the file by CROSSPIH_MEASURED. Without it a page would give the time of printing known results
for that of measuring them.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

MEASURED_VARIABLE = "CROSSPIH_MEASURED"


class Measured(BaseModel):
    """Results of one or several stores: `taken` were known from before, `made` were measured in this run.

    taken_s: seconds that the measurement of those taken over took, one after the other, None where a store does not
    know. first, last: when they were measured, UTC as ISO 8601, empty where nothing was taken over or nobody knows.
    """

    model_config = ConfigDict(frozen=True)

    taken: int = 0
    made: int = 0
    taken_s: float | None = 0.0
    first: str = ""
    last: str = ""


def record_measured(measured: Measured) -> None:
    """Add a line to the file that CROSSPIH_MEASURED names; nothing without it."""
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
    """All that a command has told through the file; nothing where there is none."""
    try:
        return _together(Measured.model_validate_json(line) for line in path.read_text(encoding="utf-8").splitlines())
    except (OSError, ValidationError):
        return Measured()
