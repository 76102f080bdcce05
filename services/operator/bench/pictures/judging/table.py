"""The table of `crosspih bench vision --pictures`."""

from __future__ import annotations

from collections import Counter

from rich import box
from rich.table import Table

from services.operator.bench.pictures.judging.verdicts import PicturesReport, RowFigures, Span

COLUMNS = (
    "row", "holes", "none", "found", "wrong", "lateral mm", "depth mm", "tilt °", "roll °", "in 95%", "ms", "plain",
    "paper",
)  # fmt: skip


def table_of(report: PicturesReport) -> Table:
    """A row of pictures a line, all of them last; beside them what two other methods say of the same pictures."""
    table = Table(
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        title=f"vision on {report.pictures}, p50 / p95 of the poses given",
        caption="none: pairs with no such hole; wrong: a pose where there is no such hole, or outside the 99.99 % "
        "region of its own covariance; plain: corners by a threshold, and solvePnP: found, lateral mm"
        + _renderers(report),
    )
    for name in COLUMNS:
        table.add_column(name, justify="left" if name == "row" else "right", no_wrap=True)
    for row in (*report.rows, report.all):
        if row is report.all:
            table.add_section()
        table.add_row(*_cells(row))
    return table


def _renderers(report: PicturesReport) -> str:
    """By which renderers' code the pictures are, where they are a mixture."""
    counts = Counter(verdict.rendered_by for verdict in report.each)
    if len(counts) < 2:
        return ""
    return "; A MIXTURE of pictures: " + ", ".join(
        f"{count} rendered by {name or 'code that is not said'}" for name, count in counts.items()
    )


def _cells(row: RowFigures) -> list[str]:
    def span(values: Span | None, digits: int = 3) -> str:
        return "" if values is None else "/".join(f"{value:.{digits}f}".removeprefix("0") for value in values)

    def other(count: int, values: Span | None) -> str:
        return f"{count}" if values is None else f"{count}: {values[0]:.2f}".replace(": 0.", ": .")

    return [
        row.row,
        str(row.holes) if row.holes else "",
        str(row.pairs - row.holes) if row.pairs > row.holes else "",
        str(row.located),
        f"[red]{row.wrong}[/red]" if row.wrong else "0",
        span(row.lateral_mm),
        span(row.depth_mm, 2),
        span(row.tilt_deg, 2),
        span(row.roll_deg, 2),
        "" if row.in_95_region is None else f"{row.in_95_region:.0%}",
        "" if row.time_s_p50 is None else f"{row.time_s_p50 * 1e3:.0f}",
        other(row.plain_located, row.plain_lateral_mm),
        other(row.paper_located, row.paper_lateral_mm),
    ]
