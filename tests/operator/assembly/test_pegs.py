"""Another peg for a stack of one's own, the swap over many seeds, and errors up to a section's own turns."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from crosspih_common.config import Workcell, load_cell
from crosspih_common.config.cell import content_alone
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.messages import AssemblyResult, Failure, PoseData, PosePrior, Strategy
from services.operator.assembly.pegs import cell_with_peg, content_with_peg
from services.operator.bench.assembly.swap import Trials, swapped
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.trials import TrialJob, base_cell_text
from services.operator.scoring.score import TrialFigures, pose_error, score

HOLE = Workcell().hole_prior.pose_base_hole()
CELL = "cell: {name: left, peg: {half_width_m: 0.008}}\nhardware: {simulated: {seed: 3}}\nvision:\n"


def _cell(folder: Path, text: str = CELL) -> Path:
    path = folder / "cell.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_another_peg_takes_the_place_of_the_cells_own(tmp_path: Path) -> None:
    cell = load_cell(_cell(tmp_path))
    content = content_with_peg(cell, "star")
    assert content is not None
    assert content["cell"] == {"name": "left", "peg": {"outline": "star"}}
    assert content["hardware"] == {"simulated": {"seed": 3}}
    assert content["force_torque"]["calibration_file"] == "run/{cell}/ft-calibration-star.yaml"
    # its own cross, though not the default one
    assert content_with_peg(cell, "cross") is None
    assert cell_content(CELL, Condition(), "star")["cell"] == {"name": "left", "peg": {"outline": "star"}}


def test_a_cell_with_another_peg_lasts_as_long_as_it_is_wanted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = str(_cell(tmp_path))
    monkeypatch.setenv("CROSSPIH_CELL", path)
    monkeypatch.setenv("CROSSPIH_ENDPOINT", "tcp/127.0.0.1:1")  # where no router is
    with cell_with_peg("star"):
        assert load_cell(os.environ["CROSSPIH_CELL"]).workcell.peg.outline == "star"
    assert os.environ["CROSSPIH_CELL"] == path
    with cell_with_peg(None):
        assert os.environ["CROSSPIH_CELL"] == path
    with pytest.raises(ConfigError, match="want one of cross"), cell_with_peg("ster"):
        pass


def _drawing(path: Path, inside: str) -> Path:
    path.parent.mkdir(exist_ok=True)
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="60mm" viewBox="0 0 60 60">'
    path.write_text(f"{head}{inside}</svg>", encoding="utf-8")
    return path


def test_a_drawings_calibration_goes_by_its_contour_and_not_by_its_name(tmp_path: Path) -> None:
    cell = load_cell(_cell(tmp_path))

    def file_of(path: Path) -> str:
        content = content_with_peg(cell, str(path))
        assert content is not None
        return str(content["force_torque"]["calibration_file"])

    square, larger = '<rect width="30" height="30"/>', '<rect width="32" height="32"/>'
    first = file_of(_drawing(tmp_path / "a" / "outline.svg", square))
    assert first.startswith("run/{cell}/ft-calibration-drawing-")
    assert file_of(_drawing(tmp_path / "b" / "other.svg", '<path d="M9 9v30h30v-30z"/>')) == first
    assert file_of(_drawing(tmp_path / "b" / "outline.svg", larger)) != first
    assert "drawing" in file_of(_drawing(tmp_path / "star.svg", square))


@pytest.mark.parametrize("text", ["", "# nothing yet\n", "cell:\n"])
def test_an_empty_cell_file_takes_another_peg(tmp_path: Path, text: str) -> None:
    content = content_with_peg(load_cell(_cell(tmp_path, text)), "star")
    assert content is not None and content["cell"] == {"peg": {"outline": "star"}}


def test_a_drawing_beside_the_cells_file_is_not_lost_where_a_bench_writes_its_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _drawing(tmp_path / "own.svg", '<rect width="30" height="30"/>')
    path = _cell(tmp_path, "cell: {peg: {outline: own.svg}}\nvision:\n")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    copies = [content_alone(load_cell(path))]
    monkeypatch.setenv("CROSSPIH_CELL", str(path))
    copies.append(cell_content(base_cell_text(), Condition()))
    for content in copies:
        copy = elsewhere / "cell.yaml"
        copy.write_text(yaml.safe_dump(content), encoding="utf-8")
        assert load_cell(copy).workcell.peg.shape().outline.area_m2 == pytest.approx(9e-4)
        assert content["vision"] == {}


@pytest.mark.parametrize(("order", "turn", "left"), [(4, 90.0, 0.0), (3, 120.0, 0.0), (3, 90.0, 30.0), (1, 90.0, 90.0)])
def test_turns_of_the_section_do_not_count(order: int, turn: float, left: float) -> None:
    estimate = HOLE @ Pose.from_rotvec([0.0, 0.0, np.deg2rad(turn)], np.zeros(3))
    assert pose_error(estimate, HOLE, order).rotation_deg == pytest.approx(left, abs=1e-6)


def test_of_a_round_only_the_tilt_counts() -> None:
    turned = Pose.from_rotvec([0.0, 0.0, 1.0], np.zeros(3))
    error = pose_error(HOLE @ Pose.from_rotvec([0.02, 0.0, 0.0], np.zeros(3)) @ turned, HOLE, 0)
    assert error.rotation_deg == pytest.approx(np.rad2deg(0.02), abs=1e-6)
    assert error.tilt_deg == pytest.approx(np.rad2deg(0.02), abs=1e-6)


def _figures(seed: int, inserted: bool, strategy: Strategy) -> TrialFigures:
    result = AssemblyResult(
        assembly_id="a",
        strategy=strategy,
        inserted=inserted,
        failure=None if inserted else Failure.NOT_CONVERGED,
        backed_off=not inserted,
        pose_base_hole=PoseData.of(HOLE @ Pose.from_translation([0.0, 0.0, seed * 1e-6])),
        covariance=tuple(np.diag([1e-10] * 6).ravel().tolist()),
        pose_base_peg=None,
        vision_pose_base_hole=None,
        motion_s=5.0,
        thinking_s=0.1,
        touches=0,
        presses=0,
        corrections=0,
        pushes=1,
        peak_force_n=5.0,
        peak_moment_nm=0.1,
        insertion_depth_m=0.025,
    )
    return score(Workcell(), result, None, wall_s=1.0, recording=None)


def test_the_swap_hands_over_what_the_cross_found_and_counts_its_failures() -> None:
    handed: dict[int, PosePrior | None] = {}

    def run(title: str, jobs: list[TrialJob]) -> Trials:
        if title == "cross":
            assert {(job.peg, job.strategy) for job in jobs} == {("cross", Strategy.FUSED)}
            return [(job, _figures(job.seed, job.seed != 2, Strategy.FUSED)) for job in jobs], None
        assert {(job.peg, job.strategy) for job in jobs} == {("star", Strategy.KNOWN_POSE)}
        handed.update({job.seed: job.known for job in jobs})
        return [(job, _figures(job.seed, True, Strategy.KNOWN_POSE)) for job in jobs], None

    done, crosses, ended = swapped([TrialJob(seed=seed, peg="star") for seed in (1, 2, 3)], run)
    assert ended is None
    assert [figures.inserted for _, figures in done] == [True, False, True]
    assert [figures.inserted for _, figures in crosses] == [True, False, True] and crosses[1] == done[1]
    assert sorted(handed) == [1, 3]
    known = handed[3]
    assert known is not None
    assert known.pose_base_hole == PoseData.of(HOLE @ Pose.from_translation([0.0, 0.0, 3e-6]))
    with pytest.raises(ConfigError, match="name the other peg"):
        swapped([TrialJob(seed=1)], run)
