"""A line of the doctor's table. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import Enum

from pydantic import BaseModel, ConfigDict


class Verdict(str, Enum):
    """How it stands: with `wrong` no assembly can start, or it would not end well."""

    OK = "ok"
    WARNING = "warning"
    WRONG = "wrong"


class Row(BaseModel):
    """What was looked at, what was found, and what mends it."""

    model_config = ConfigDict(frozen=True)

    name: str
    verdict: Verdict
    found: str
    mend: str = ""


def ok(name: str, found: str) -> Row:
    """All is well."""
    return Row(name=name, verdict=Verdict.OK, found=found)


def warning(name: str, found: str, mend: str) -> Row:
    """It goes without, less well."""
    return Row(name=name, verdict=Verdict.WARNING, found=found, mend=mend)


def wrong(name: str, found: str, mend: str) -> Row:
    """So it cannot go."""
    return Row(name=name, verdict=Verdict.WRONG, found=found, mend=mend)


def looked(name: str, look: Callable[[], Iterable[Row]]) -> list[Row]:
    """The rows of one look; a look that fails itself is a row, so that the others are still told."""
    try:
        return list(look())
    except Exception as error:
        said = f"could not be looked at: {type(error).__name__}: {error}"
        return [warning(name, said, "a defect of crosspih doctor: please report it with this line")]
