"""A cell's file: what is wrong is named, with the field and the mend."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.config import Section, Workcell, cell_name, cell_of_text, load_cell
from crosspih_common.config.spelling import did_you_mean, words_of
from crosspih_common.errors import ConfigError


class Example(Section):
    limit_n: float = 1.0


def _write(path: Path, text: str) -> Path:
    file = path / "cell.yaml"
    file.write_text(text)
    return file


def test_the_shipped_cell_loads() -> None:
    assert load_cell("deploy/cells/default.yaml").workcell.name == "cell1"


def test_sections_reach_their_service(tmp_path: Path) -> None:
    cell = load_cell(_write(tmp_path, "cell: {name: left}\nvision: {limit_n: 2.5}\n"))
    assert cell.workcell.name == "left"
    assert cell.section("vision", Example).limit_n == 2.5
    assert cell.section("planning", Example).limit_n == 1.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cell: {nmae: a}", "cell.nmae: no such setting"),
        ("cell: {name: A B}", "cell.name"),
        ("visoin: {}", "visoin: no such section; want one of"),
        ("cell: [1]", "cell: wants a mapping, got list"),
        ("- 1", "wants a mapping of sections"),
        ("cell: {hole: {clearance_m: -1}}", "cell.hole.clearance_m"),
        ("cell: {hole: {clearance_m: .nan}}", "cell.hole.clearance_m"),
        (
            "cell: {hole: {tolerance: {size_m: 0.05}}}",
            "size_m: wants one standard deviation in metres, 1e-06 to 0.0005",
        ),
        ("cell: {hole: {tolerance: {edge_break_m: 0}}}", "cell.hole.tolerance.edge_break_m: wants"),
        ("cell: {hole: {tolerance: {chamfer_m: -1e-5}}}", "cell.hole.tolerance.chamfer_m: wants"),
        ("cell: {hole: {tolerance: {size_mm: 0.05}}}", "cell.hole.tolerance.size_mm: no such setting"),
        ("a: [", "is not YAML"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words.replace(".", r"\.")):
        load_cell(_write(tmp_path, text))


def test_a_service_names_its_own_wrong_setting(tmp_path: Path) -> None:
    cell = load_cell(_write(tmp_path, "vision: {limt_n: 2.5}"))
    with pytest.raises(ConfigError, match=r"vision\.limt_n: no such setting; remove it or mend its spelling"):
        cell.section("vision", Example)


def test_a_missing_file_says_how_to_name_one() -> None:
    with pytest.raises(ConfigError, match="CROSSPIH_CELL"):
        load_cell("nowhere.yaml")


def test_the_nominal_hole_is_t0() -> None:
    pose = Workcell().hole_prior.pose_base_hole()
    assert np.allclose(pose.translation_m, [0.4, -0.3, 0.2])
    assert np.allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
    assert np.allclose(pose.rotation[:, 2], [1.0, 0.06, 0.07], atol=0.01)


def test_compliance_is_symmetric_and_gives_way_to_force() -> None:
    compliance = Workcell().compliance_peg((-0.98, 1.16, 0.12, -1.05, -1.5, 0.3))
    assert np.allclose(compliance, compliance.T)
    assert np.all(np.linalg.eigvalsh(compliance) > 0.0)
    stiffness_n_mm = 1e-3 / np.diag(compliance)[:3]
    assert np.all((stiffness_n_mm > 20.0) & (stiffness_n_mm < 500.0))


def test_a_correction_in_its_old_place_is_read_and_two_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    old = "force_torque: {filter_hz: 40, sensor_correction: {shift_m: [0.001, 0, 0], turn_rad: [0, 0.05, 0]}}\n"
    path.write_text(old, encoding="utf-8")
    cell = load_cell(path)
    correction = cell.workcell.force_torque.correction
    assert (correction.shift_m, correction.turn_rad) == ((0.001, 0.0, 0.0), (0.0, 0.05, 0.0))
    assert cell.sections["force_torque"] == {"filter_hz": 40}
    assert cell.workcell.sensor_mounting().pose_peg_sensor.rotvec_rad() == pytest.approx([0.0, 0.05, 0.0])
    path.write_text(old + "cell: {force_torque: {correction: {}}}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"is now cell\.force_torque\.correction"):
        load_cell(path)


@pytest.mark.parametrize("path", sorted(Path("deploy/cells").glob("*.yaml")), ids=lambda path: path.stem)
def test_the_name_alone_is_that_of_the_whole_file(path: Path) -> None:
    assert cell_name(path) == load_cell(path).workcell.name


@pytest.mark.parametrize("text", ["", "cell:", "cell: {}", "planning: {no_such: 1}"])
def test_a_file_without_a_name_has_the_default_one(tmp_path: Path, text: str) -> None:
    (tmp_path / "cell.yaml").write_text(text, encoding="utf-8")
    assert cell_name(tmp_path / "cell.yaml") == Workcell().name


@pytest.mark.parametrize("text", ["cell: {name: A b}", "cell: {name: 3}", "cell: [", "cell: {name: ''}"])
def test_what_is_no_name_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "cell.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"cell\.yaml: "):
        cell_name(tmp_path / "cell.yaml")


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("cell: {nam: a}", "cell.nam: no such setting; remove it or mend its spelling: did you mean name?"),
        ("cell: {hole: {clearence_m: 1.0e-4}}", "did you mean clearance_m?"),
        ("cell: {surroundings: {boxes: [{nmae: post}]}}", "remove it or mend its spelling: did you mean name?"),
        ("cell: {arm: {nmae: irb120}}", "did you mean name?"),
        ("plannnig: {}", "did you mean planning?"),
        ("cell: {peg: {outline: sqare}}", "did you mean square?"),
    ],
)  # fmt: skip
def test_a_misspelt_word_is_told_what_it_was_meant_to_be(text: str, meant: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(meant)) as raised:
        cell_of_text(Path("a.yaml"), text)
    assert raised.value.field


def test_what_is_near_nothing_is_told_nothing() -> None:
    assert did_you_mean("zzz", ["name", "hole"]) == ""
    assert did_you_mean("FRICTION", ["friction"]) == "did you mean friction?"
    assert words_of("'realtime' or 'max'") == ["realtime", "max"]
