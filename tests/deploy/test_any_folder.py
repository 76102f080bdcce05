"""The stack from any folder: one whose own packages are called as ours, one with blanks and umlauts, without a home."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.keys import RECORD_START, RECORD_STOP
from crosspih_common.messages import StartRecording, StopRecording
from tests.deploy.harness import ROOT

DEADLINE_S = 120.0
OURS = ("crosspih_common", "services", "deploy")
NOT_OURS = "raise SystemExit('a package of the folder was run, not ours')\n"


class Elsewhere:
    """The packages as a wheel lays them, and a folder from which they are used."""

    def __init__(self, folder: Path) -> None:
        self.site, self.caller = folder / "Bücher & Räume" / "site-packages", folder / "fremder Ordner"
        for name in OURS:
            shutil.copytree(ROOT / name, self.site / name, ignore=shutil.ignore_patterns("__pycache__"))
            (self.caller / name).mkdir(parents=True)
            (self.caller / name / "__init__.py").write_text(NOT_OURS)
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        self.before = self.files(self.site)
        kept = {
            name: value for name, value in os.environ.items() if not name.startswith("CROSSPIH_") and name != "HOME"
        }
        self.environment = {
            **kept,
            "CROSSPIH_ENDPOINT": self.endpoint,
            "PYTHONPATH": str(self.caller),
            "PYTHONDONTWRITEBYTECODE": "1",
        }

    @staticmethod
    def files(folder: Path) -> set[str]:
        return {str(path.relative_to(folder)) for path in folder.rglob("*") if "__pycache__" not in path.parts}

    def crosspih(self, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
        runner = str(self.site / "crosspih_common" / "run_module.py")
        return subprocess.run(
            [sys.executable, runner, "services.operator", *arguments],
            cwd=self.caller, env={**self.environment, **variables}, capture_output=True, text=True, check=False,
            timeout=DEADLINE_S,
        )  # fmt: skip


@pytest.fixture
def elsewhere(tmp_path: Path) -> Elsewhere:
    return Elsewhere(tmp_path)


def test_the_stack_is_ours_and_what_it_keeps_lands_in_the_callers_folder(elsewhere: Elsewhere) -> None:
    up = elsewhere.crosspih("up", "--detach", "--wait", "--wait-timeout", "90", "router", "recorder")
    try:
        assert up.returncode == 0, up.stderr
        assert json.loads(elsewhere.crosspih("ps", "--json").stdout)["up"] is True
        with Bus(open_zenoh(elsewhere.endpoint), "cell1", "operator") as bus:
            path = Path(bus.call(RECORD_START, StartRecording(name="here"), DEADLINE_S).path)
            bus.call(RECORD_STOP, StopRecording(), DEADLINE_S)
        assert path.parent == elsewhere.caller / "recordings" and path.is_file()
    finally:
        down = elsewhere.crosspih("down")
    assert down.returncode == 0, down.stderr
    assert (elsewhere.caller / "run" / "crosspih").is_dir()
    assert elsewhere.files(elsewhere.site) == elsewhere.before


def test_a_stated_data_folder_that_cannot_be_is_one_line(elsewhere: Elsewhere, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    up = elsewhere.crosspih("up", "router", CROSSPIH_DATA=str(tmp_path / "file" / "below"))
    assert up.returncode == 1
    said = up.stderr.strip().splitlines()
    assert len(said) == 1 and "below" in said[0] and "CROSSPIH_" in said[0], said
