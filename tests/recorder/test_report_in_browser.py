"""A report as a browser opens it from a file: the charts are drawn, and nothing is complained about."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from services.operator.report import make_comparison, make_report
from tests.recorder.synthetic import write_assembly

BROWSER = next((path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), "")


@pytest.mark.skipif(not BROWSER, reason="no Chromium on this machine")
def test_the_page_opens_from_a_file(tmp_path: Path) -> None:
    write_assembly(tmp_path / "a.mcap", push_n=8.0, presses=2)
    make_report(tmp_path / "a.mcap", tmp_path / "one.html")
    make_comparison(tmp_path / "a.mcap", tmp_path / "a.mcap", tmp_path / "two.html")
    for page, charts in ((tmp_path / "one.html", 6), (tmp_path / "two.html", 3)):
        done = subprocess.run(
            [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}",
             "--enable-logging=stderr", "--virtual-time-budget=3000", "--dump-dom", page.as_uri()],
            capture_output=True, text=True, timeout=240, check=True,
        )  # fmt: skip
        assert f'data-charts="{charts}"' in done.stdout
        assert done.stdout.count("<canvas") == charts
        assert "CONSOLE" not in done.stderr, done.stderr
