"""Any row of a bench can be watched: its command, whose trial tests/operator/test_bench_pool.py makes once more."""

from __future__ import annotations

from itertools import pairwise

import pytest

from crosspih_common.messages import PosePrior, Strategy
from services.operator.assembly.as_bench import watch_command
from services.operator.bench.cells.conditions import condition_of
from services.operator.bench.cells.trials import TrialJob

SETTING = "hardware.simulated.friction_coefficient=0.2"


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
