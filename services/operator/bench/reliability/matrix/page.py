"""The table of the matrix, for people and as a section of a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel

from crosspih_common.errors import ConfigError
from services.operator.bench.reliability.matrix.judging import MatrixObservation, complaints, lost, outcome
from services.operator.bench.reliability.matrix.plan import MatrixCase

BEGIN, END = "<!-- made by `crosspih bench matrix`: begin -->", "<!-- end -->"
COLUMNS = ("ended", "by", "in", "outcome", "result, s", "healthy, s", "recording lost", "holds")


class MatrixResult(BaseModel):
    """One case, its observation, and everything that is wrong."""

    case: MatrixCase
    seen: MatrixObservation

    @property
    def complaints(self) -> list[str]:
        """By the present rules."""
        return complaints(self.case, self.seen)

    def cells(self) -> tuple[str, ...]:
        """A line of the table."""
        case, seen = self.case, self.seen
        return (
            case.victim,
            case.ending.text,
            case.phase.value,
            outcome(case, seen),
            _figure(seen.result_s),
            _figure(seen.healthy_s),
            lost(seen),
            "; ".join(self.complaints) or "yes",
        )


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


def section(rows: Sequence[MatrixResult], command: str, planned: int) -> str:
    """Markdown: the cases that were run, how many of them hold, and a line per case."""
    held = sum(1 for row in rows if not row.complaints)
    lines = [f"`{command}`: {held} of {len(rows)} cases hold; {planned} are planned, {len(rows)} were run.", ""]
    lines.append("| " + " | ".join(COLUMNS) + " |")
    lines.append("|" + "---|" * len(COLUMNS))
    for row in rows:
        lines.append("| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row.cells()) + " |")
    return "\n".join(lines)


def write_section(page: Path, text: str) -> None:
    """Put the text between the page's two marks. Raises ConfigError for a missing page, or one without the marks."""
    try:
        content = page.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"--page {page}: cannot be read ({error.strerror})") from None
    before, begin, rest = content.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ConfigError(f"--page {page}: has no line {BEGIN!r} with {END!r} after it, between which the table goes")
    page.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", encoding="utf-8")
