"""The HTML page about two recordings."""

from __future__ import annotations

from pathlib import Path

from crosspih_common.recording import read_recording
from services.operator.report.comparing import compared_charts, figure_rows, setting_rows
from services.operator.report.model import Facts, facts_of
from services.operator.report.page import environment, scripts, write
from services.operator.report.stills import stills_of
from services.operator.report.words import how, verdict


def render_comparison(one: Facts, other: Facts) -> str:
    """The page as text."""
    data = compared_charts(one, other)
    differ, same = setting_rows(one, other)
    return environment().get_template("comparison.html.j2").render(
        **scripts(data),
        both=[(letter, facts, verdict(facts), how(facts)) for letter, facts in (("A", one), ("B", other))],
        stills=[stills_of(facts).ended[-1:] for facts in (one, other)],
        figures=figure_rows(one, other),
        differ=differ,
        same=same,
        charts=[(chart["id"], chart["label"], chart["says"]) for chart in data["charts"]],
        common=data["common"],
        first=data["first"],
    )  # fmt: skip


def make_comparison(one: str | Path, other: str | Path, html_path: str | Path) -> None:
    """Write the page about two recordings. Raises RecordingError, OSError for the page."""
    write(render_comparison(facts_of(read_recording(one)), facts_of(read_recording(other))), html_path)
