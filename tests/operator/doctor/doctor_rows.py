"""What the tests of the doctor share: cells, and how rows are read."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timezone
from pathlib import Path

from crosspih_common.config import CellFile, cell_of_text
from services.operator.cli.rows import Row, Verdict

NOW = datetime(2026, 3, 1, tzinfo=timezone.utc)
ROOT = Path(__file__).resolve().parents[3]


def verdicts(rows: Iterator[Row] | list[Row]) -> dict[str, str]:
    return {row.name: row.verdict.value for row in rows}


def cell_of(text: str = "cell: {name: cell1}") -> CellFile:
    return cell_of_text(Path("cell.yaml"), text)


def every_bad_row_has_a_mend(rows: list[Row]) -> bool:
    return all(row.mend for row in rows if row.verdict is not Verdict.OK)
