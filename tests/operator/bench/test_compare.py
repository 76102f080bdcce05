"""The challenge's score and the comparison of strategies, from trials made up to have known answers."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from crosspih_common.errors import ConfigError
from crosspih_common.messages import Strategy
from services.operator.assembly.show import summary
from services.operator.bench.assembly.command import figures_table
from services.operator.bench.cells.trials import TrialJob
from services.operator.bench.compare.command import CONDITIONS, STRATEGIES, Vision
from services.operator.bench.compare.comparison import Comparison, compare_strategies
from services.operator.bench.compare.figure import save_figure
from services.operator.bench.compare.table import compare_table
from services.operator.bench.domain.boxes import DomainResult, boxes_of
from services.operator.bench.domain.boxes import table_of as domain_table
from services.operator.bench.domain.factors import Factor, FactorLevel
from services.operator.bench.protocols.assembling import ProtocolResult, ProtocolTrial
from services.operator.bench.protocols.assembling import table_of as protocols_table
from services.operator.bench.refinement_gain.command import compared_table
from services.operator.bench.reliability.busy.loading import BusyResult, ended
from services.operator.bench.reliability.busy.loading import table_of as busy_table
from services.operator.scoring.challenge_score import MAX_SCORE, challenge_score
from services.operator.scoring.score import TrialFigures
from services.operator.scoring.statistics import Sight, sight_row, summarise


def scored(**changed: object) -> float:
    given_figures = {
        "inserted": True,
        "failure": None,
        "duration_s": 5.0,
        "mean_jerk_m_s3": 0.0,
        "tip_path_m": 0.3,
        "start_distance_m": 0.3,
        "over_20_n_s": 0.0,
        **changed,
    }
    return challenge_score(**given_figures).total  # type: ignore[arg-type]


def test_a_perfect_trial_has_all_points() -> None:
    assert scored() == MAX_SCORE == 100.0


def test_the_parts_have_their_published_weights() -> None:
    assert scored(duration_s=60.0) == pytest.approx(88.0)
    assert scored(duration_s=32.5) == pytest.approx(94.0)
    assert scored(mean_jerk_m_s3=50.0) == pytest.approx(94.0)
    assert scored(tip_path_m=1.3) == pytest.approx(94.0)
    assert scored(tip_path_m=0.8) == pytest.approx(97.0)
    assert scored(over_20_n_s=1.0) == pytest.approx(100.0)
    assert scored(over_20_n_s=1.01) == pytest.approx(88.0)
    assert scored(inserted=False, failure="not_converged") == pytest.approx(1.0)
    assert scored(inserted=False, failure="not_converged", over_20_n_s=2.0) == pytest.approx(-11.0)
    assert scored(inserted=False, failure="service_lost") == pytest.approx(0.0)


@settings(deadline=None)
@given(st.floats(0, 500), st.floats(0, 500), st.floats(0, 10), st.floats(0, 1), st.floats(0, 60), st.booleans())
def test_no_trial_leaves_the_scale(
    duration_s: float, jerk: float, path_m: float, distance_m: float, heavy_s: float, inserted: bool
) -> None:
    points = scored(
        inserted=inserted, duration_s=duration_s, mean_jerk_m_s3=jerk, tip_path_m=path_m, start_distance_m=distance_m,
        over_20_n_s=heavy_s,
    )  # fmt: skip
    assert -12.0 <= points <= MAX_SCORE
    assert (points > 60.0) == inserted


def figures(seed: int, strategy: Strategy, inserted: bool) -> TrialFigures:
    return TrialFigures(
        seed=seed,
        strategy=strategy.value,
        inserted=inserted,
        failure=None if inserted else "not_converged",
        failure_detail="",
        backed_off=not inserted,
        motion_s=7.0 if inserted else 70.0,
        thinking_s=1.0,
        duration_s=8.0 if inserted else 71.0,
        wall_s=3.0,
        touches=seed,
        presses=4,
        corrections=0,
        pushes=1,
        peak_force_n=10.0 + seed,
        peak_moment_nm=1.0,
        mean_force_n=4.0,
        over_20_n_s=0.0,
        tip_path_m=0.4,
        mean_jerk_m_s3=5.0,
        challenge_score=95.0 if inserted else 1.0,
        vision_error_mm=0.1,
        vision_error_deg=0.1,
        vision_tilt_deg=0.1,
        vision_depth_mm=0.1,
        final_error_mm=0.01 if inserted else None,
        final_error_deg=0.02 if inserted else None,
        final_depth_mm=0.0 if inserted else None,
        insertion_depth_mm=25.0 if inserted else None,
        recording=None,
        report=None,
    )


def comparison() -> Comparison:
    done = []
    for vision in (Vision.GOOD, Vision.OFF):
        for strategy in (Strategy.STRAIGHT, Strategy.FUSED):
            for seed in range(4):
                inserted = strategy is Strategy.FUSED or (vision is Vision.GOOD and seed < 2)
                job = TrialJob(seed=seed, strategy=strategy, condition=CONDITIONS[vision])
                done.append((job, figures(seed, strategy, inserted)))
    return compare_strategies(0, done)


def test_rows_are_by_condition_and_strategy() -> None:
    rows = comparison().of("good vision")
    assert [(row.strategy, row.all.inserted) for row in rows] == [("straight", 2), ("fused", 4)]
    straight = rows[0]
    assert straight.mean_score == pytest.approx(48.0)
    assert straight.inserted is not None
    # the time is of those that are in, the rest of all
    assert straight.inserted.figures["duration_s"].p50 == pytest.approx(8.0)
    assert straight.all.figures["peak_force_n"].p50 == pytest.approx(11.5)
    assert straight.all.failures == {"not_converged": 2}
    assert comparison().of("no vision")[0].inserted is None


def test_a_comparison_survives_its_json() -> None:
    made = comparison()
    assert Comparison.model_validate_json(made.model_dump_json()) == made


def test_the_table_and_the_figure_show_every_strategy(tmp_path: Path) -> None:
    made = comparison()
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(compare_table(made, "no vision"))
    text = console.export_text()
    assert "straight" in text and "4/4" in text and "0/4" in text and "4 not converged" in text
    for suffix in (".png", ".svg"):
        save_figure(made, tmp_path / "figures" / f"compare{suffix}")
        assert (tmp_path / "figures" / f"compare{suffix}").stat().st_size > 5000
    with pytest.raises(ConfigError, match=r"\.png"):
        save_figure(made, tmp_path / "compare.txt")


def test_what_is_compared_is_there() -> None:
    assert set(STRATEGIES) <= set(Strategy) and Strategy.FUSED in STRATEGIES
    assert set(CONDITIONS) == set(Vision)


@pytest.mark.parametrize("rank, said", [(5, False), (4, True)])
def test_what_the_walls_do_not_hold_is_said(rank: int, said: bool) -> None:
    each = [figures(seed, Strategy.FUSED, True).model_copy(update={"rank": rank}) for seed in range(3)]
    written = io.StringIO()
    Console(file=written, width=120).print(figures_table(summarise("round", 0, each)))
    shown = " ".join(written.getvalue().split())
    assert ("4 of 5; how a round is turned about its axis nothing tells" in shown) is said


def unseen(seed: int, code: str, felt_for: bool, inserted: bool = True) -> TrialFigures:
    about = {"looked": code != "switched_off", "vision_refused": code, "felt_for": felt_for, "touches": 2}
    return figures(seed, Strategy.FUSED, inserted).model_copy(update=about)


def test_what_vision_refused_and_force_found_is_told_by_every_bench() -> None:
    """An insertion by force alone is none by vision, and must not pass for one."""
    seen = figures(0, Strategy.FUSED, True).model_copy(update={"looked": True})
    trials = [
        seen,
        unseen(1, "no_cross", True),
        unseen(2, "too_dark", True, False),
        unseen(3, "no_cross", False, False),
    ]
    result = summarise("fused", 0, trials)
    assert result.sight == Sight(
        looked=4, refused={"no_cross": 2, "too_dark": 1}, felt_for=2, felt_for_inserted=1, untouched=1
    )
    assert result.sight.short == "3, 2" and json.loads(result.model_dump_json())["sight"]["felt_for"] == 2
    assert sight_row(trials)[1] == "4, 3, 2"
    without_cameras = summarise("fused", 0, [unseen(4, "switched_off", True)])
    assert (without_cameras.sight.looked, without_cameras.sight.short) == (0, "0, 1")
    busy = BusyResult(
        speed="max", busy_processes=0, cores=2, inserted=2, stopped=0, assemblies=[ended(0, one) for one in trials]
    )
    comparison = compare_strategies(0, [(TrialJob(seed=one.seed or 0), one) for one in trials])
    factor = Factor("light", True, (FactorLevel("usual", {}),))
    boxes = boxes_of([factor], [(TrialJob(seed=one.seed or 0), one) for one in trials], 0)
    domain = DomainResult(strategy="fused", seed=0, trials=4, boxes=boxes)
    each = [ProtocolTrial(seed=0, inserted=True, failure=None, detail="", looked=True, felt_for=True)]
    tables = {
        "refused: no_cross": figures_table(result), "4, 3, 2": busy_table(busy), "3, 2": domain_table(domain),
        " 3, 2 ": compare_table(comparison, "default"), "3, 2  ": compared_table(result, result),
        "1, 0, 1": protocols_table(ProtocolResult(way="ur", inserted=1, trials=each)),
        "refused (no_cross), found by force": summary(trials[1]),
    }  # fmt: skip
    for said, table in tables.items():
        console = Console(width=200, record=True, file=io.StringIO())
        console.print(table)
        assert said.strip() in console.export_text(), said
