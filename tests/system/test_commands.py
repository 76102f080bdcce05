"""The `crosspih` commands as processes beside the running cell: what they print, and how they end."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from crosspih_common.keys import PHASE, commands, topics
from crosspih_common.messages import Phase
from services.operator.assembly.session import Session
from services.operator.cli.commands import app
from tests.system.running_cell import SERVICES, KillOnPhase, RunningCell

NAMED_BY_CONTRACT = {
    "seed",
    "strategy",
    "inserted",
    "failure",
    "motion_s",
    "thinking_s",
    "duration_s",
    "wall_s",
    "touches",
    "corrections",
    "peak_force_n",
    "vision_error_mm",
    "vision_error_deg",
    "final_error_mm",
    "final_error_deg",
    "insertion_depth_mm",
    "recording",
}


def test_assemble_prints_one_object_and_nothing_else(cell: RunningCell, session: Session) -> None:
    done = cell.cli("assemble", "--seed", "1002", "--json")
    figures = json.loads(done.stdout)
    assert done.stdout.count("\n") == 1
    assert figures.keys() >= NAMED_BY_CONTRACT
    assert figures["seed"] == 1002 and figures["strategy"] == "fused"
    assert figures["inserted"] is True and figures["failure"] is None
    assert done.returncode == 0
    assert Path(figures["recording"]).is_file() and Path(figures["report"]).is_file()
    assert "locating" in done.stderr and "inserted" in done.stderr


def test_assemble_that_fails_names_the_failure_and_ends_with_a_status(cell: RunningCell, session: Session) -> None:
    kill = KillOnPhase(cell, "hardware", lambda phase: phase.phase is Phase.APPROACHING)
    session.bus.subscribe(PHASE, kill)
    done = cell.cli("assemble", "--seed", "1002", "--json", "--no-record")
    figures = json.loads(done.stdout)
    assert figures.keys() >= NAMED_BY_CONTRACT
    assert figures["inserted"] is False and figures["failure"] == "service_lost"
    assert figures["recording"] is None
    assert done.returncode == 1
    assert kill.killed_pid is not None
    cell.wait_restarted("hardware", kill.killed_pid)


@pytest.mark.parametrize("command", [("assemble", "--json"), ("calibrate", "ft")])
def test_the_other_speed_is_refused_in_one_line(session: Session, command: tuple[str, ...]) -> None:
    done = CliRunner().invoke(app, [*command, "--speed", "realtime"])
    assert done.exit_code == 1
    said = [line for line in done.output.splitlines() if line.strip() and not line.startswith('{"error"')]
    assert len(said) == 1, said
    assert "--speed realtime" in said[0] and "max" in said[0] and "crosspih down" in said[0]


def test_a_speed_that_is_none_is_refused_in_one_line() -> None:
    done = CliRunner().invoke(app, ["assemble", "--speed", "warp", "--json"])
    assert done.exit_code == 2 and "warp" in json.loads(done.stdout)["error"]["text"]
    assert "warp" in done.stderr and "Traceback" not in done.stderr


def test_bench_gives_counts_and_distributions(cell: RunningCell, session: Session) -> None:
    done = cell.cli("bench", "assembly", "--running", "--trials", "2", "--seed", "1000", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["trials"] == 2 and result["inserted"] == 2 and result["failures"] == {}
    assert 0.0 < result["wilson95_low"] < result["wilson95_high"] <= 1.0
    assert result["figures"]["duration_s"]["count"] == 2
    assert result["figures"]["peak_force_n"]["max"] < 60.0


def test_calibrate_finds_the_weight_wherever_the_arm_stands(cell: RunningCell, session: Session) -> None:
    """The tests before this one have left the peg in the hole; a calibration takes it out first."""
    done = cell.cli("calibrate", "ft")
    assert done.returncode == 0, done.stdout
    weight = re.search(r"weight +([0-9.]+) N", done.stdout.split("bias", 1)[1])
    assert weight is not None
    assert float(weight.group(1)) == pytest.approx(0.974 * 9.81, abs=0.02)
    assert str(cell.calibration_file) in done.stdout.replace("\n", "")
    saved = yaml.safe_load(cell.calibration_file.read_text(encoding="utf-8"))
    assert saved["cell"] == cell.name
    assert str(saved["calibrated_at"])
    assert 0.0 < saved["force_rms_n"] < 0.1


def test_keys_lists_the_whole_table() -> None:
    done = CliRunner().invoke(app, ["keys"])
    assert done.exit_code == 0
    echoes = {f"{command.path}/{end}" for command in commands() for end in ("request", "reply")}
    for path in {topic.path for topic in topics()} - echoes | {command.path for command in commands()}:
        assert re.search(rf"(?<![\w/]){re.escape(path)}(?![\w/])", done.stdout), path


def test_ps_shows_every_service_as_one_object(cell: RunningCell, session: Session) -> None:
    done = CliRunner().invoke(app, ["ps", "--json"])
    state = json.loads(done.stdout)
    assert done.exit_code == 0 and state["up"] is True
    rows = {row["service"]: row for row in state["services"]}
    assert set(rows) == set(SERVICES)
    assert {row["health"] for row in rows.values()} == {"healthy"}
    pids = cell.pids()
    assert {name: row["pid"] for name, row in rows.items()} == {name: pids[name] for name in SERVICES}
