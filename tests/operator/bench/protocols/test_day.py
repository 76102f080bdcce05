"""docs/hardware/in-a-day.md as it is walked: its commands exist with those options, its cell's file holds, and the
cell behind the practice devices is not as its file says."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from crosspih_common.config import Workcell, cell_of_text
from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry import Pose
from services.hardware.config import hardware_of
from services.hardware.peers.following import FollowingCamera
from services.hardware.peers.seen import JointsTeller
from services.operator.bench.cells.conditions import merged
from services.operator.bench.protocols.assembling import calibrated_cell
from services.operator.bench.protocols.board import put_board
from services.operator.bench.protocols.day import PAGE, runs
from services.operator.bench.protocols.hidden import BOARD, behind, cameras_of, held_by_hand, true_cameras
from services.operator.bench.protocols.page import PageStep, steps_of
from services.operator.bench.protocols.plants import (
    ADDRESSES,
    ARM,
    HERE,
    LEFT,
    RIGHT,
    SEEN_PORT,
    SENSOR,
    ProtocolWay,
    base_content,
)
from services.operator.bench.protocols.scoring_day import camera_rows, tool_rows, true_tool, truth_lines
from services.operator.cell.init.command import asked, given_answers
from services.operator.cell.init.questions import questions
from services.operator.cell.init.writing import cell_text
from services.operator.cli.commands import app
from services.operator.cli.rows import Verdict
from services.operator.doctor.calibrations import camera_rows as doctor_rows

STEPS = steps_of(PAGE.read_text(encoding="utf-8"))
DRIVERS: list[dict[str, Any]] = [
    {"name": "ur", "opens": ["arm", "force_torque"], "address": "ur.host"},
    {"name": "ati", "opens": ["force_torque"], "address": "ati.host"},
    {"name": "genicam", "opens": ["camera"], "address": "genicam.left"},
]


def _commands() -> list[PageStep]:
    return [step for step in STEPS if step.kind == "command" and step.words[0] == "crosspih"]


@pytest.mark.parametrize("words", sorted({step.words for step in _commands()}), ids=lambda words: " ".join(words))
def test_each_command_of_the_page_exists_with_its_options(words: tuple[str, ...]) -> None:
    said = CliRunner().invoke(app, [*words[1:], "--help"])  # what is not there is refused before
    assert said.exit_code == 0 and "Usage" in said.output, said.output


def test_an_option_that_is_not_there_would_be_told() -> None:
    assert CliRunner().invoke(app, ["calibrate", "tcp", "--of-no-use", "--help"]).exit_code == 2


def test_the_page_begins_with_a_file_and_ends_with_an_assembly() -> None:
    walked = [step.words for step in STEPS if runs(step)]
    assert ("crosspih", "cell", "init") in {words[:3] for words in walked}
    assert walked[-1] == ("crosspih", "assemble")
    assert {words[1:3] for words in walked if words[1] == "calibrate"} == {
        ("calibrate", what) for what in ("ft", "board", "stereo", "hand-eye", "tcp", "mount", "stiffness")
    }


def _cell_text(tmp_path: Path) -> str:
    """The file that section 2 makes, with what it adds and what practising adds."""
    init = next(step for step in _commands() if step.words[1:3] == ("cell", "init"))
    single = [after for before, after in zip(init.words, init.words[1:], strict=False) if before == "--answer"]
    answers = asked(questions(DRIVERS), given_answers(None, single), False, None)  # type: ignore[arg-type]
    text = cell_text(answers, tmp_path / "lab.yaml", {one["name"]: str(one["address"]) for one in DRIVERS})
    added = next(step.lines for step in STEPS if step.kind == "file" and step.section == 2)
    assert added is not None
    return yaml.safe_dump(merged(merged(yaml.safe_load(text), added), {"hardware": HERE}))


def test_the_file_that_the_page_makes_names_the_practice_devices(tmp_path: Path) -> None:
    file = cell_of_text(tmp_path / "lab.yaml", _cell_text(tmp_path))
    config = hardware_of(file)
    assert config.ur is not None and config.ati is not None and config.genicam is not None
    named = config.ur.host, config.ati.host, config.genicam.left, config.genicam.right
    assert named == ADDRESSES == (ARM, SENSOR, LEFT, RIGHT)
    assert file.sections["operator"]["board"]["pattern"] == BOARD
    assert config.limits.missed_cycles == 10000


def test_a_cameras_file_is_looked_for_beside_the_cells_file(tmp_path: Path) -> None:
    content = merged(yaml.safe_load(_cell_text(tmp_path)), {"hardware": {"genicam": {"calibration": "cameras.yaml"}}})
    (tmp_path / "cameras.yaml").write_text("left: {}", encoding="utf-8")
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    config = hardware_of(cell_of_text(tmp_path / "lab.yaml", yaml.safe_dump(content)))
    assert config.genicam is not None and config.genicam.calibration == (tmp_path / "cameras.yaml").resolve()
    found = calibrated_cell(tmp_path / "lab.yaml", 3).content["hardware"]["genicam"]["calibration"]
    assert found == str((tmp_path / "cameras.yaml").resolve())


@pytest.mark.parametrize("way", list(ProtocolWay))
def test_what_stands_behind_the_devices_is_not_as_its_file_says(way: ProtocolWay) -> None:
    base = base_content(way)
    assert behind(base, None) is base
    real, other = behind(base, 1), behind(base, 2)
    assert real["hardware"]["simulated"]["truth"] != other["hardware"]["simulated"]["truth"]
    told, true = Workcell.model_validate(base["cell"]), true_cameras(real)
    nominal = cameras_of(told.camera)
    off = {row.what: row for row in camera_rows(nominal, true, real)}
    assert all(row.before > 0.01 and row.after == pytest.approx(0.0, abs=1e-6) for row in off.values())
    peg, _, stiffness = true_tool(real)
    assert np.linalg.norm(peg.translation_m - told.pose_flange_peg().translation_m) > 5e-5
    rows = tool_rows(told, told, real)
    assert {row.what.split(",")[0] for row in rows} == {"tcp", "mount", "stiffness"}
    assert all(abs(row.before) > 0.01 for row in rows)
    assert len(stiffness) == 6 and len(truth_lines(real)) == 6


def test_the_board_is_held_where_both_cameras_see_it_before_the_plate() -> None:
    real = behind(base_content(ProtocolWay.UR), 1)
    held, cameras = held_by_hand(real, 1), true_cameras(real)
    outline = BoardPattern.of(BOARD).outline_m()
    hole = Workcell.model_validate(real["cell"]).hole_prior.pose_base_hole()
    assert len(held) >= 40
    for place, turn in held:
        corners = Pose.from_rotvec(turn, place).apply(outline)
        assert hole.inverse().apply(corners)[:, 2].max() < 0.0
        seen = cameras.pose_base_camera.pose().inverse().apply(corners)
        assert seen[:, 2].min() > 0.02


class _Camera:
    """Keeps what it is told; its pictures are nobody's."""

    exposure_s = 0.02

    def __init__(self) -> None:
        self.joints: list[float] = []
        self.boards: list[Any] = []

    def arm_stands_at(self, joints_rad: Any) -> None:
        self.joints = joints_rad.tolist()

    def board_at(self, pose: Pose | None, there: bool = True) -> None:
        self.boards.append((None if pose is None else pose.translation_m[0], there))

    def capture(self, exposure_scale: float, lamp: int) -> Any:
        raise NotImplementedError


def test_cameras_follow_the_arm_of_another_process_and_whoever_holds_the_board() -> None:
    camera = _Camera()
    poses = [Pose.from_translation([float(number), 0.0, 0.0]) for number in (1, 2)]
    following = FollowingCamera(camera, SEEN_PORT, poses)  # type: ignore[arg-type]
    seen = JointsTeller(f"127.0.0.1:{SEEN_PORT}")
    try:
        assert put_board("hand")
        for _ in range(3):
            with pytest.raises(NotImplementedError):
                following.capture(1.0, 0)
        assert put_board("flange")
        with pytest.raises(NotImplementedError):
            following.capture(1.0, 0)
        assert camera.boards == [(1.0, True), (2.0, True), (1.0, True), (None, True)]
        until_s = time.monotonic() + 10.0
        seen.cycle(np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))
        while not camera.joints and time.monotonic() < until_s:
            assert put_board("away")  # answered after what came before it
        assert camera.joints == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    finally:
        seen.close()
        following.close()


def test_the_doctor_says_whose_numbers_the_cameras_have(tmp_path: Path) -> None:
    text = _cell_text(tmp_path)
    (row,) = doctor_rows(cell_of_text(tmp_path / "lab.yaml", text), {"genicam"})
    assert row.verdict is Verdict.WARNING and "crosspih calibrate stereo" in row.mend
    named = yaml.safe_dump(merged(yaml.safe_load(text), {"hardware": {"genicam": {"calibration": "cameras.yaml"}}}))
    cell = cell_of_text(tmp_path / "lab.yaml", named)
    assert [row.verdict for row in doctor_rows(cell, {"genicam"})] == [Verdict.WRONG]
    (tmp_path / "cameras.yaml").write_text("left: {}", encoding="utf-8")
    assert [row.verdict for row in doctor_rows(cell, {"genicam"})] == [Verdict.OK]
