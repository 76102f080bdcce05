"""One HTML page about one recorded assembly."""

from __future__ import annotations

from pathlib import Path


def make_report(mcap_path: str | Path, html_path: str | Path) -> None:
    """Write the page about a recording. Raises RecordingError when the file is no recording, OSError for the page."""
    # matplotlib takes its time to load: commands that make no page should not wait for it
    from services.operator.report.page import make_report as make

    make(mcap_path, html_path)


__all__ = ["make_report"]
