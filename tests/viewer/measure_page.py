"""Does an open page slow assemblies? `python -m tests.viewer.measure_page [--trials 5] [--speed max] [--chromium]`.

The same seeds without and with a page open, in turn, on one stack; prints each trial, and the medians. The page is a
WebSocket that takes all that a browser is sent; with `--chromium` a browser too, which draws in software here, behind
everything else (nice 19): what it takes is its own machine's, where that is another one.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec
import pytest
from websockets.exceptions import ConnectionClosed

from crosspih_common.messages import Strategy
from deploy.launcher import StackRequest, start_stack
from tests.system.running_cell import DEADLINE_S, PROJECT, RunningCell
from tests.viewer.test_in_a_browser import CHROMIUM, FLAGS
from tests.viewer.test_page_over_loopback import EYE, opened


@contextmanager
def reading(address: str) -> Iterator[list[int]]:
    """A page that is open; how many bytes it was sent."""
    host = address.removeprefix("http://").rstrip("/")
    took = [0]

    def take() -> None:
        with suppress(ConnectionClosed):
            for window in page:
                took[0] += len(window)

    with opened(int(host.rpartition(":")[2])) as page:
        page.send(msgspec.msgpack.encode(EYE))
        reader = threading.Thread(target=take, daemon=True)
        reader.start()
        yield took
    reader.join(10.0)


@contextmanager
def drawing(address: str, wanted: bool) -> Iterator[None]:
    """A browser that draws the page, behind everything else."""
    if not wanted:
        yield
        return
    assert CHROMIUM is not None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = [CHROMIUM, *FLAGS, "--headless=new", f"--user-data-dir={profile}", "--window-size=1280,800"]
        words += ["--remote-debugging-port=0", address]
        browser = subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=lambda: os.nice(19)
        )
        try:
            threading.Event().wait(20.0)  # until it draws
            yield
        finally:
            browser.terminate()
            browser.wait(20.0)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--speed", choices=("max", "realtime"), default="max")
    parser.add_argument("--chromium", action="store_true")
    asked = parser.parse_args()
    walls: dict[bool, list[float]] = {False: [], True: []}
    motions: dict[bool, list[float]] = {False: [], True: []}
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as environment:
        cell = RunningCell(Path(folder), "measured", environment)
        environment.setenv("CROSSPIH_SPEED", asked.speed)
        start_stack(StackRequest(project=PROJECT, profiles=("viewer",)), wait_healthy=True, timeout_s=DEADLINE_S)
        try:
            address = cell.row("viewer").note
            with cell.session() as session:
                session.trial(0, Strategy.FUSED, record=True)  # it calibrates the sensor
                for seed in range(1, asked.trials + 1):
                    order = (False, True) if seed % 2 else (True, False)
                    for page in order:
                        if page:
                            with reading(address) as took, drawing(address, asked.chromium):
                                figures, result = session.trial(seed, Strategy.FUSED, record=True)
                        else:
                            figures, result = session.trial(seed, Strategy.FUSED, record=True)
                        walls[page].append(figures.wall_s)
                        motions[page].append(result.motion_s)
                        sent = f", {took[0] / 1e6:.1f} MB to the page" if page else ""
                        print(
                            f"seed {seed} {'with' if page else 'without'} a page: inserted {result.inserted}, "
                            f"wall {figures.wall_s:.2f} s, motion {result.motion_s:.2f} s{sent}", flush=True,
                        )  # fmt: skip
        finally:
            cell.stop()
    for name, values in (("wall", walls), ("motion", motions)):
        without, with_page = statistics.median(values[False]), statistics.median(values[True])
        pairs = statistics.median(b / a for a, b in zip(values[False], values[True], strict=True))
        print(
            f"{name}: median {without:.2f} s without, {with_page:.2f} s with a page; of the pairs' ratios the median "
            f"is {pairs:.3f}"
        )


if __name__ == "__main__":
    main()
