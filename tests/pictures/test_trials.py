"""Trials whose cameras show the pictures of scenes: the seeds are the scenes', the truth is the simulated cell's."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from crosspih_common.errors import CrosspihError
from services.operator.bench.cells.trials import TrialJob
from services.operator.bench.pictures.trials import with_pictures

SET = Path("tests/pictures/set")


def test_each_trial_gets_a_scene_of_its_own_and_that_scenes_seed(tmp_path: Path) -> None:
    jobs = with_pictures([TrialJob(seed=index) for index in range(3)], SET, ["matt", "metal_soft"], tmp_path)
    assert len({job.seed for job in jobs}) == 3
    for job in jobs:
        hardware = job.condition.overrides["hardware"]
        assert hardware["drivers"] == {"camera": "pictures"}
        shown = hardware["pictures"]
        left, right = (cv2.imread(shown[side][0], cv2.IMREAD_UNCHANGED) for side in ("left", "right"))
        assert left is not None and right is not None and not np.array_equal(left, right)
        calibration = json.loads(Path(shown["calibration"]).read_text(encoding="utf-8"))
        assert (calibration["left"]["height_px"], calibration["left"]["width_px"]) == left.shape


def test_rows_without_the_cells_hole_give_no_trial(tmp_path: Path) -> None:
    with pytest.raises(CrosspihError, match="has 0 scenes for the default cell, 1 trials"):
        with_pictures([TrialJob(seed=0)], SET, ["print_inner"], tmp_path)
