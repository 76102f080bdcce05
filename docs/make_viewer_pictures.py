"""`python -m docs.make_viewer_pictures`: the pictures of docs/viewer.md, taken of the page itself in a browser.

Wants viser, playwright and a chromium. Starts a stack of its own, clicks Assemble, holds the assembly in its middle,
lets it go on and waits for its end; then the page of the sample on a phone, and of recordings, one by force alone,
alone and beside another.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

from deploy.launcher import StackRequest, start_stack, stop_stack

HERE = Path(__file__).parent / "viewer"
SAMPLE = Path(__file__).parent / "sample" / "assembly.mcap"
PROJECT = "viewer-pictures"
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SLOW_MS = 300_000  # a browser that draws in software
DRAWN_S = 4.0  # what was sent is on the screen
PORT, ENDPOINT = 8431, "tcp/127.0.0.1:7431"


def settle(seconds: float = DRAWN_S) -> None:
    """Until what was sent has been drawn: a browser does not say when."""
    threading.Event().wait(seconds)


def opened(browser: Browser, address: str, width: int, height: int, dark: bool, phone: bool = False) -> Page:
    """The page, in a window of that size."""
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light",
        is_mobile=phone, has_touch=phone, device_scale_factor=2 if phone else 1,
    )  # fmt: skip
    page = context.new_page()
    page.on("console", lambda said: print(f"console: {said.type}: {said.text}") if said.type == "error" else None)
    page.on("pageerror", lambda error: print(f"page error: {error}"))
    page.goto(address, timeout=SLOW_MS)
    page.wait_for_selector("canvas", timeout=SLOW_MS)
    page.locator(".chip").first.wait_for(timeout=SLOW_MS, state="attached")
    settle(2 * DRAWN_S)
    # viser's word that this machine draws in software, which a reader's does not
    page.evaluate("document.querySelectorAll('[class*=Notification-root]').forEach(one => one.remove())")
    return page


def keep(page: Page, name: str, most_width: int = 1440) -> None:
    """A picture of the page, in few colours, so that it stays small."""
    shot = cv2.imdecode(np.frombuffer(page.screenshot(timeout=SLOW_MS), np.uint8), cv2.IMREAD_COLOR)
    assert shot is not None
    if shot.shape[1] > most_width:
        scale = most_width / shot.shape[1]
        shot = cv2.resize(shot, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    HERE.mkdir(exist_ok=True)
    cv2.imwrite(str(HERE / f"{name}.png"), shot, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"docs/viewer/{name}.png: {(HERE / f'{name}.png').stat().st_size // 1024} kB", flush=True)


def press(page: Page, text: str) -> None:
    """Press a button, and wait until what it does is drawn."""
    page.get_by_role("button", name=text, exact=True).first.click(timeout=SLOW_MS)
    settle()


def live(browser: Browser) -> None:
    """An assembly by the page's own buttons."""
    page = opened(browser, f"http://127.0.0.1:{PORT}/", 1440, 900, dark=False)
    page.get_by_role("button", name="Assemble").click(timeout=SLOW_MS)
    page.locator(".chip", has_text=re.compile("approaching|pushing")).wait_for(timeout=SLOW_MS)
    page.get_by_role("button", name="Pause").click(timeout=SLOW_MS)
    page.get_by_role("button", name="Go on").wait_for(timeout=SLOW_MS)
    press(page, "hole")
    keep(page, "live")
    go_on = page.get_by_role("button", name="Go on")
    if go_on.is_visible():
        go_on.click(timeout=SLOW_MS)
    page.locator(".chip", has_text="inserted").wait_for(timeout=SLOW_MS)
    page.locator(".note:not(.bad)", has_text="recorded").wait_for(timeout=SLOW_MS)
    press(page, "cell")
    page.get_by_role("tab", name="Pictures").click(timeout=SLOW_MS)
    settle()
    keep(page, "end")
    page.context.close()


def on_a_phone(browser: Browser) -> None:
    """The page of the sample's recording."""
    with playing([SAMPLE]) as address:
        page = opened(browser, address, 390, 844, dark=False, phone=True)
        keep(page, "phone", 585)
        page.context.close()


@contextmanager
def stack(folder: Path, speed: str) -> Iterator[None]:
    """A stack of its own, with the page."""
    os.environ |= {
        "CROSSPIH_ENDPOINT": ENDPOINT, "CROSSPIH_SPEED": speed, "CROSSPIH_VIEWER_PORT": str(PORT),
        "CROSSPIH_DATA": str(folder), "CROSSPIH_RUN_DIR": str(folder / "run"), "CROSSPIH_PROJECT": PROJECT,
    }  # fmt: skip
    start_stack(StackRequest(project=PROJECT, profiles=("viewer",)), wait_healthy=True, timeout_s=120.0)
    try:
        yield
    finally:
        stop_stack(PROJECT)


@contextmanager
def playing(files: list[Path]) -> Iterator[str]:
    """The page of recordings; yields its address."""
    words = [sys.executable, "-m", "services.viewer", "--port", str(PORT + 1), "--recording", *map(str, files)]
    served = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert served.stdout is not None
    try:
        yield served.stdout.readline().removeprefix("viewer: ").strip()
    finally:
        served.terminate()
        served.wait(10.0)


def recorded(browser: Browser, files: list[Path]) -> None:
    """The page of a recording in its middle, in the dark; and of two side by side."""
    with playing(files[:1]) as address:
        page = opened(browser, address, 1440, 900, dark=True)
        page.get_by_label("See through").check(timeout=SLOW_MS)
        while "correcting" not in page.locator(".chip").first.inner_text(timeout=SLOW_MS):
            press(page, "next ▶")
        press(page, "hole")
        keep(page, "recording")
        page.context.close()
    with playing(files) as address:
        page = opened(browser, address, 1440, 900, dark=False)
        for _ in range(4):
            press(page, "next ▶")
        keep(page, "side-by-side")
        page.context.close()


def assemble(*words: str) -> None:
    """One assembly on the running stack."""
    subprocess.run([sys.executable, "-m", "services.operator", "assemble", *words], check=True, stdout=sys.stderr)


def main() -> None:
    """All pictures; or those of the words given: live, phone, recorded."""
    asked: Any = sys.argv[1:] or ["live", "phone", "recorded"]
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as name, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=FLAGS)
        folder = Path(name)
        if "live" in asked:
            with stack(folder, "realtime"):
                live(browser)
        if "phone" in asked:
            on_a_phone(browser)
        if "recorded" in asked:
            with stack(folder, "max"):
                assemble("--seed", "7", "--strategy", "force_alone")
                assemble("--seed", "7")
            made = folder / "recordings"
            recorded(browser, [*sorted(made.glob("*force_alone*.mcap")), *sorted(made.glob("*fused-seed7*.mcap"))][:2])
        browser.close()


if __name__ == "__main__":
    main()
