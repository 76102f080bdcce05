"""One HTML page about a recorded assembly, or about two of them side by side."""

from __future__ import annotations

from pathlib import Path


def make_report(mcap_path: str | Path, html_path: str | Path) -> None:
    """Write the page about a recording. Raises RecordingError when the file is no recording, OSError for the page."""
    # the templates and plotting packages take time to load: commands that make no page should not wait
    from services.operator.report.page import make_report as make

    make(mcap_path, html_path)


def make_comparison(one: str | Path, other: str | Path, html_path: str | Path) -> None:
    """Write the page about two recordings. Raises RecordingError when a file is no recording, OSError for the page."""
    from services.operator.report.comparison_page import make_comparison as make

    make(one, other, html_path)


__all__ = ["make_comparison", "make_report"]
