"""`crosspih cell check` over real processes: a sound cell, the same with a second one on its keys, and no camera."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT, ServiceProcess
from tests.system.running_cell import wait_until

DEADLINE_S = 180.0


def check(cell: Path, endpoint: str) -> tuple[int, dict[str, Any]]:
    """Its exit status and what it says."""
    done = subprocess.run(
        [sys.executable, "-m", "services.operator", "cell", "check", "--json", "--cell", str(cell)],
        cwd=ROOT,
        env={**os.environ, "CROSSPIH_ENDPOINT": endpoint},
        capture_output=True,
        text=True,
        check=False,
        timeout=DEADLINE_S,
    )
    assert done.stdout, done.stderr
    said: dict[str, Any] = json.loads(done.stdout)
    return done.returncode, said


def failed(said: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {one["name"]: one for one in said["rows"] if one["verdict"] == "wrong"}


def test_a_sound_cell_and_then_two_on_its_keys(
    endpoint: str, spawn: Callable[..., ServiceProcess], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CROSSPIH_SPEED", "max")
    cell = tmp_path / "cell.yaml"
    cell.write_text("cell:\n  name: looked-at\nhardware:\n  driver: tests.system.bare_driver:open_devices\n")
    start = ("hardware", "--cell", str(cell), "--endpoint", endpoint)
    first = spawn(*start)
    first.wait_for_line("physics by")
    status, said = check(cell, endpoint)
    while status and "hardware is not there" in str(said):  # it starts slowly on a busy machine
        status, said = check(cell, endpoint)
    assert status == 0 and said["ok"], failed(said)
    assert {one["verdict"] for one in said["rows"]} == {"ok"}
    second = spawn(*start)
    second.wait_for_line("physics by")

    def doubled() -> bool:
        status, said = check(cell, endpoint)
        wrong = failed(said).get("one cell on its keys")
        return status == 1 and wrong is not None and "cell.name" in wrong["mend"] and "boot ids" in wrong["found"]

    wait_until(doubled, "two cells are named")
