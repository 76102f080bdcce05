"""`crosspih cell check` over real processes: a sound cell, and a second one of its name that is not let in."""

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

DEADLINE_S = 180.0


def check(cell: Path, endpoint: str, *options: str) -> tuple[int, dict[str, Any]]:
    """Its exit status and what it says."""
    done = subprocess.run(
        [sys.executable, "-m", "services.operator", "cell", "check", "--json", "--cell", str(cell), *options],
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


def test_a_sound_cell_and_a_second_one_that_is_not_let_in(
    endpoint: str, spawn: Callable[..., ServiceProcess], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CROSSPIH_SPEED", "max")
    cell = tmp_path / "cell.yaml"
    cell.write_text("cell:\n  name: looked-at\nhardware:\n  driver: tests.system.bare_driver:open_devices\n")
    start = ("hardware", "--cell", str(cell), "--endpoint", endpoint)
    first = spawn(*start)
    first.wait_for_line("physics by")
    status, said = check(cell, endpoint, "--camera")
    while status and "camera is not there" in str(said):  # it starts slowly on a busy machine
        status, said = check(cell, endpoint, "--camera")
    assert status == 0 and said["ok"], failed(said)
    # a second one of the same name is not let in, and the first is sound all the same
    second = spawn(*start)
    assert second.wait_for_line("second_service")
    assert second.process.wait(DEADLINE_S) == 1
    status, said = check(cell, endpoint)
    assert status == 0 and said["ok"], failed(said)
    assert {one["verdict"] for one in said["rows"]} == {"ok"}
