"""Any row of a bench can be watched: `crosspih assemble --as-bench` is its trial once more."""

from __future__ import annotations

import json
import os
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest

from crosspih_common.messages import PosePrior, Strategy
from crosspih_common.modules import module_command
from services.operator.assembly.as_bench import watch_command
from services.operator.bench.cells.conditions import condition_of
from services.operator.bench.cells.trials import WALL_FIGURES, TrialJob
from services.operator.scoring.score import TrialFigures

SETTING = "hardware.simulated.friction_coefficient=0.2"


def _said(tmp_path: Path, *words: str) -> dict[str, object]:
    environment = {**os.environ, "CROSSPIH_DATA": str(tmp_path)}
    environment.pop("CROSSPIH_CELL", None)
    command = module_command("services.operator", *words, "--json")
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=400, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found: dict[str, object] = json.loads(done.stdout)
    return found


@pytest.mark.timeout(900)  # two stacks, one after the other; seconds where nothing else runs
def test_a_row_of_a_bench_is_made_once_more_to_the_last_bit(tmp_path: Path) -> None:
    options = ("--seed", "1003", "--set", SETTING)
    store = str(tmp_path / "trials.jsonl")
    bench = _said(tmp_path, "bench", "assembly", "--trials", "1", "--cells", "1", "--store", store, *options)
    each = bench["each"]
    assert isinstance(each, list)
    row, watched = TrialFigures.model_validate(each[0]), _said(tmp_path, "assemble", "--as-bench", *options)
    left_out = {*WALL_FIGURES, "recording", "report", "recording_parts", "recording_warnings"}
    assert TrialFigures.model_validate(watched).model_dump(exclude=left_out) == row.model_dump(exclude=left_out)
    assert row.inserted and Path(str(watched["report"])).is_file()


def test_a_bench_names_the_command_that_shows_a_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CROSSPIH_CELL", raising=False)
    condition = condition_of([SETTING, "planning.max_advices=0"])
    job = TrialJob(seed=7, strategy=Strategy.SPIRAL, peg="star", condition=condition)
    words = watch_command(job).split()
    assert words[:7] == ["crosspih", "assemble", "--as-bench", "--seed", "7", "--strategy", "spiral"]
    given = [word for before, word in pairwise(words) if before == "--set"]
    assert condition_of(given).overrides == condition.overrides and "--peg star" in " ".join(words)
    pose = {"position_m": (0.0, 0.0, 0.0), "quaternion_xyzw": (0.0, 0.0, 0.0, 1.0)}
    covariance = tuple(1.0 if index % 7 == 0 else 0.0 for index in range(36))
    known = PosePrior.model_validate({"pose_base_hole": pose, "covariance": covariance})
    assert "--after-cross" in watch_command(job.model_copy(update={"known": known}))
