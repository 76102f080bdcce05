"""The output of `crosspih doctor` and `crosspih cell check`: a line for each thing that was checked."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Sequence
from enum import Enum

import typer
from pydantic import BaseModel, ConfigDict
from rich.console import Console
from rich.markup import escape
from rich.table import Table


class Verdict(str, Enum):
    """The verdict on one thing."""

    OK = "ok"
    WARNING = "warning"  # an assembly works without it, but less well
    WRONG = "wrong"
    SKIPPED = "skipped"  # it could not be checked; another line says why


COLOURS = {Verdict.OK: "green", Verdict.WARNING: "yellow", Verdict.WRONG: "bold red", Verdict.SKIPPED: "yellow"}


class Row(BaseModel):
    """What was checked, what was found, and how to mend it."""

    model_config = ConfigDict(frozen=True)

    name: str
    verdict: Verdict
    found: str
    mend: str = ""


def ok(name: str, found: str) -> Row:
    """All is well."""
    return Row(name=name, verdict=Verdict.OK, found=found)


def warning(name: str, found: str, mend: str) -> Row:
    """It works, but less well."""
    return Row(name=name, verdict=Verdict.WARNING, found=found, mend=mend)


def wrong(name: str, found: str, mend: str) -> Row:
    """It cannot work like this."""
    return Row(name=name, verdict=Verdict.WRONG, found=found, mend=mend)


def skipped(name: str, why: str) -> Row:
    """It was not checked."""
    return Row(name=name, verdict=Verdict.SKIPPED, found=why)


def looked(name: str, look: Callable[[], Iterable[Row]]) -> list[Row]:
    """The rows of one check. A check that fails itself becomes a row, so that the others are still shown."""
    try:
        return list(look())
    except Exception as error:
        said = f"could not be looked at: {type(error).__name__}: {error}"
        return [warning(name, said, "a defect of crosspih doctor: please report it with this line")]


def wrong_ones(rows: Sequence[Row]) -> list[Row]:
    """The rows that are wrong."""
    return [row for row in rows if row.verdict is Verdict.WRONG]


def table_of(rows: Sequence[Row], title: str | None = None) -> Table:
    """One line each."""
    table = Table(title=title, show_lines=bool(wrong_ones(rows)))
    for heading in ("check", "verdict", "found", "mend"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        colour = COLOURS[row.verdict]
        table.add_row(
            escape(row.name), f"[{colour}]{row.verdict.value}[/{colour}]", escape(row.found), escape(row.mend)
        )
    return table


def tell(rows: Sequence[Row], cell: str, console: Console, as_json: bool, last: str, title: str | None = None) -> None:
    """Print the rows as a table with a last line, or as one JSON object {ok, cell, rows}. Raises typer.Exit(1) when one
    is wrong.
    """
    bad = wrong_ones(rows)
    if as_json:
        said = {"ok": not bad, "cell": cell, "rows": [row.model_dump(mode="json") for row in rows]}
        sys.stdout.write(json.dumps(said) + "\n")
    else:
        console.print(table_of(rows, title))
        console.print(last, highlight=False)
    if bad:
        raise typer.Exit(1)
