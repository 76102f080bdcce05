"""An assembly is started by a click in a browser, and seen to end."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from deploy.launcher import StackRequest, start_stack
from tests.system.running_cell import DEADLINE_S, PROJECT, RunningCell

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
# a renderer of its own, in software: a machine that tests may have no graphics
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
ENDS_MS = 200_000
PARTED = """() => {
  const box = (which) => document.querySelector(which).getBoundingClientRect();
  const view = box("canvas"), sheet = box('[style*="max-height: 60%"]');
  return view.width === 390 && sheet.width === 390 && view.height > 300
    && Math.abs(view.bottom - sheet.top) < 1 && Math.abs(sheet.bottom - 844) < 1;
}"""


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium to open the page in")
def test_an_assembly_is_started_from_the_page_and_seen_to_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("viser", reason="the page wants viser: pip install 'crosspih[viewer]'")
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: pip install playwright")
    cell = RunningCell(tmp_path, "viewed", monkeypatch)
    start_stack(StackRequest(project=PROJECT, profiles=("viewer",)), wait_healthy=True, timeout_s=DEADLINE_S)
    wrong: list[str] = []
    try:
        with playwright.sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
            page = browser.new_page(viewport={"width": 820, "height": 560})
            page.on("pageerror", lambda error: wrong.append(str(error)))
            page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
            page.goto(cell.row("viewer").note)
            page.get_by_role("button", name="Assemble").click(timeout=ENDS_MS)
            page.locator(".chip", has_text="inserted").wait_for(timeout=ENDS_MS)
            page.locator(".note:not(.bad)", has_text="recorded in").wait_for(timeout=ENDS_MS)
            # on a phone the panel is below the view, as wide as the window, and nothing is wider
            page.set_viewport_size({"width": 390, "height": 844})
            page.locator('[style*="max-height: 60%"]').wait_for(timeout=ENDS_MS)
            page.wait_for_function(PARTED, timeout=ENDS_MS)
            browser.close()
    finally:
        cell.stop()
    assert wrong == []
    assert len(list(cell.recordings.glob("assembly-fused-seed1-*.mcap"))) == 1
