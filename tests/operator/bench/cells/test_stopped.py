"""A bench that is told to end, or killed, leaves nothing behind that it started."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import ROOT

DEADLINE_S = 120.0


def _hears_interrupts() -> None:
    """A bench that is started in the background of a script hears no Ctrl-C, and what the tests are run by may be."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _wait_until(condition: Callable[[], bool], what: str) -> None:
    until, pause = time.monotonic() + DEADLINE_S, threading.Event()
    while not condition():
        assert time.monotonic() < until, what
        pause.wait(0.05)


def _descendants(pid: int) -> dict[int, str]:
    """(process: its command line) of all that it started, and what these started."""
    found: dict[int, str] = {}
    waiting = [pid]
    while waiting:
        for task in Path(f"/proc/{waiting.pop()}/task").glob("*/children"):
            try:
                children = [int(word) for word in task.read_text().split()]
                found |= {child: Path(f"/proc/{child}/cmdline").read_text().replace("\0", " ") for child in children}
            except OSError:  # it has just ended
                continue
            waiting += children
    return found


def _living(processes: dict[int, str]) -> dict[int, str]:
    """Of these, those that still run the same command; zombies have none."""

    def runs(pid: int, command: str) -> bool:
        try:
            return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ") == command
        except OSError:
            return False

    return {pid: command for pid, command in processes.items() if command and runs(pid, command)}


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="who started whom is read from /proc")
@pytest.mark.parametrize(
    ("signals", "up"),  # a stack that has come up, and one that is just coming up
    [
        ((signal.SIGTERM,), "services.planning"),
        ((signal.SIGINT, signal.SIGINT), "services.router"),
        ((signal.SIGKILL,), "services.router"),
    ],
    ids=["SIGTERM", "SIGINT twice", "SIGKILL"],
)
def test_its_workers_and_their_stacks_end_with_it(signals: tuple[signal.Signals, ...], up: str, tmp_path: Path) -> None:
    arguments = ["bench", "assembly", "--trials", "2", "--cells", "1", "--store", str(tmp_path / "trials.jsonl")]
    _ends_with_all_it_started(arguments, signals, up, tmp_path, "stopped after 0 of 2 trials")


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="who started whom is read from /proc")
def test_the_bench_that_results_runs_ends_with_it(tmp_path: Path) -> None:
    plan = tmp_path / "plan.yaml"
    plan.write_text("- {name: one, title: One, command: crosspih bench assembly --trials 2 --seed 1000, quick: ''}\n")
    arguments = ["results", "--plan", str(plan), "--page", str(tmp_path / "page.md"), "--kept", str(tmp_path / "kept")]
    arguments += ["--cells", "1"]
    _ends_with_all_it_started(
        arguments, (signal.SIGTERM,), "services.router", tmp_path, "the same command goes on from here"
    )


def _ends_with_all_it_started(
    arguments: list[str], signals: tuple[signal.Signals, ...], up: str, tmp_path: Path, last_words: str
) -> None:
    bench = subprocess.Popen(
        [sys.executable, "-m", "services.operator", *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)},
        cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        preexec_fn=_hears_interrupts,
    )  # fmt: skip
    started: dict[int, str] = {}

    def has_a_stack() -> bool:
        started.update(_descendants(bench.pid))
        return any(up in command for command in started.values())

    try:
        _wait_until(has_a_stack, "its stack comes up")
        for number in signals:
            bench.send_signal(number)
        _, said = bench.communicate(timeout=DEADLINE_S)
        if signal.SIGKILL in signals:
            assert bench.returncode == -signal.SIGKILL
            _wait_until(lambda: not _living(started), "all that it started ends by itself")
        else:
            assert bench.returncode == 130 and last_words in said, said
            assert "Traceback" not in said
            assert not _living(started)
        _wait_until(lambda: not list(tmp_path.glob("crosspih-*")), "the worker's folder is removed")
    finally:
        for pid in _living(started):  # by their own pids, where the test failed
            os.kill(pid, signal.SIGKILL)
        bench.kill()
        bench.wait()
