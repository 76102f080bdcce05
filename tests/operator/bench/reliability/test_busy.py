"""`crosspih bench busy`: what it counts as stopped, and that its busy processes end with it."""

from __future__ import annotations

import multiprocessing
from typing import cast

import pytest

from crosspih_common.errors import NoService
from crosspih_common.messages import Failure
from services.operator.assembly.session import Session
from services.operator.bench.reliability.busy.loading import (
    NO_RESULT,
    BusyResult,
    Ended,
    assemble_once,
    busy_processes,
    ended,
    table_of,
)
from services.operator.scoring.score import TrialFigures

UNKNOWN = (
    "vision_error_mm", "vision_error_deg", "vision_tilt_deg", "vision_depth_mm", "final_error_mm", "final_error_deg",
    "final_depth_mm", "insertion_depth_mm", "recording", "report",
)  # fmt: skip


def _figures(**changes: object) -> TrialFigures:
    known = {
        "seed": 3, "strategy": "fused", "inserted": False, "failure": None, "failure_detail": "", "backed_off": True,
        "motion_s": 1.0, "thinking_s": 1.0, "duration_s": 2.0, "wall_s": 4.0, "touches": 0, "presses": 0,
        "corrections": 0, "pushes": 0, "peak_force_n": 1.0, "peak_moment_nm": 0.1, "mean_force_n": 1.0,
        "over_20_n_s": 0.0, **dict.fromkeys(UNKNOWN),
    }  # fmt: skip
    return TrialFigures.model_validate({**known, **changes})


@pytest.mark.parametrize("failure", [Failure.ARM_STOPPED, Failure.SERVICE_LOST])
def test_the_lease_and_a_lost_service_count_as_stopped(failure: Failure) -> None:
    assert ended(3, _figures(failure=failure.value)).stopped


def test_other_ends_do_not() -> None:
    assert not ended(3, _figures(failure=Failure.OVERLOAD.value)).stopped
    assert not ended(3, _figures(inserted=True, failure=None)).stopped


class _Unanswered:
    """A session whose planner does not answer."""

    def trial(self, *asked: object) -> None:
        raise NoService("planning/assemble: nobody answers")


def test_an_assembly_without_a_result_counts_as_stopped_and_is_not_tried_again() -> None:
    told = Ended.model_validate(assemble_once(cast(Session, _Unanswered()), {"seed": 4, "strategy": "fused"}))
    assert (told.seed, told.stopped, told.failure) == (4, True, NO_RESULT)
    assert "nobody answers" in told.detail


def test_the_table_tells_every_kind_of_end() -> None:
    rows = [ended(3, _figures(inserted=True, failure=None)), ended(3, _figures(failure=Failure.ARM_STOPPED.value))]
    result = BusyResult(speed="max", busy_processes=8, cores=2, inserted=1, stopped=1, assemblies=rows)
    cells = [cell for column in table_of(result).columns for cell in column.cells]
    assert "1 of 2" in cells
    assert f"ended as {Failure.ARM_STOPPED.value}" in cells


def test_busy_processes_end_with_the_block() -> None:
    with busy_processes(2):
        assert len(multiprocessing.active_children()) == 2
    assert not multiprocessing.active_children()
