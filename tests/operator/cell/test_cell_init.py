"""`crosspih cell init`: answers typed, from a file and by options; odd ones are refused with what would be right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from crosspih_common.config import cell_of_text, load_cell
from services.operator.cell.drivers import installed_drivers
from services.operator.cell.init import command
from services.operator.cell.init.answers import InvalidAnswer
from services.operator.cell.init.questions import Question, questions
from services.operator.cell.init.writing import cell_text
from services.operator.cli.commands import app

ROOT = Path(__file__).resolve().parents[3]
DH = """
dh: [[0, 0.3, 0, -1.5708], [0, 0, 0.4, 0], [0, 0, 0, -1.5708], [0, 0.4, 0, 1.5708], [0, 0, 0, -1.5708], [0, 0.1, 0, 0]]
lower_rad: [-3, -3, -3, -3, -2, -3]
upper_rad: [3, 3, 3, 3, 2, 3]
speed_rad_s: [3, 3, 3, 3, 3, 3]
acceleration_rad_s2: [9, 9, 9, 9, 9, 9]
"""
# as an arm of another maker with drivers of its own would be listed
REAL = [
    {"name": "simulated", "opens": ["arm", "force_torque", "camera"], "address": ""},
    {"name": "robo", "opens": ["arm", "force_torque"], "address": "robo.host"},
    {"name": "feeler", "opens": ["force_torque"], "address": "feeler.host"},
    {"name": "pictures", "opens": ["camera"], "address": "pictures.calibration"},
    {"name": "plugged", "opens": [], "address": ""},
]


@pytest.fixture(scope="module")
def known() -> list[dict[str, Any]]:
    """What the command is told by the real listing, once."""
    return installed_drivers()


@pytest.fixture
def run(known: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    def invoke(*arguments: str, typed: str = "", drivers: list[dict[str, Any]] | None = None) -> Any:
        monkeypatch.setattr(command, "installed_drivers", lambda: drivers or known)
        monkeypatch.chdir(tmp_path)
        return CliRunner().invoke(app, ["cell", "init", *arguments], input=typed)

    return invoke


@pytest.mark.parametrize("arm", ["xb4", "ur5e", "panda"])
def test_the_defaults_make_a_cell_that_reads_and_is_never_written_over(run: Any, tmp_path: Path, arm: str) -> None:
    result = run("cell.yaml", "--yes", "--answer", f"arm={arm}")
    assert result.exit_code == 0 and "crosspih doctor --cell cell.yaml" in result.output
    cell = load_cell(tmp_path / "cell.yaml")
    assert cell.workcell.arm().name == arm and cell.sections["hardware"]["driver"] == "simulated"
    again = run("cell.yaml", "--yes")
    assert again.exit_code == 1 and "is there already; another name, or --force" in again.output
    assert run("cell.yaml", "--yes", "--force").exit_code == 0


def test_what_is_typed_is_checked_at_once_and_asked_again(run: Any, tmp_path: Path) -> None:
    typed = [
        "My Cell", "bench3",  # small letters are wanted
        "irb120", "xb4",
        "nobody", "",  # the driver: simulated
        "zero", "0.07",
        "both", "reaction",
        "same",
        "nothing.svg", str(ROOT / "docs" / "drawings" / "flower.svg"),
        "1", "0.0001",
        "0.4 -0.3", "0.4 -0.3 0.2",
        "0 0 0", "-1 0 0", "1 0.06 0.07",  # no direction; out of reach
        "-1", "0.008",
        "ground", "none",
        "7000", "45",
    ]  # fmt: skip
    result = run("cell.yaml", typed="\n".join(typed) + "\n")
    assert result.exit_code == 0, result.output
    for words in (
        "want small letters", "want xb4, ur5e, panda", "want one of", "want 1 numbers", "want load or reaction",
        "there is no such file", "metres on every side", "want 3 numbers: x y z", "want a direction",
        "does not reach the nominal hole", "from 0.0001 to 0.1", "or none", "from 5 to 500",
    ):  # fmt: skip
        assert words in " ".join(result.output.split()), words
    cell = load_cell(tmp_path / "cell.yaml")
    assert cell.workcell.name == "bench3" and cell.workcell.peg.shape().outline.name == "flower"
    assert cell.workcell.force_torque.reports.value == "reaction"
    assert cell.workcell.surroundings.floor_height_m is None
    assert cell.sections["hardware"]["limits"] == {"force_cap_n": 45.0}
    assert "# docs/pegs.md" in cell.text


def test_a_file_of_answers_makes_a_real_cell_with_its_drivers_and_addresses(run: Any, tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text(DH)
    answers = {
        "name": "lab", "arm": "arm.yaml", "home_joints_rad": [0, -1, 1, 0, 1, 0], "driver": "robo",
        "address": "192.168.0.10", "sensor_driver": "feeler", "sensor_address": "sensor.lab", "camera_driver": "none",
        "hole_position_m": [0.5, 0.0, 0.1], "hole_axis": [0, 0, -1], "moved_mass_kg": 8, "floor_height_m": None,
    }  # fmt: skip
    (tmp_path / "answers.yaml").write_text(yaml.safe_dump(answers))
    result = run("lab.yaml", "--answers", "answers.yaml", "--yes", drivers=REAL)
    assert result.exit_code == 0, result.output
    cell = load_cell(tmp_path / "lab.yaml")
    hardware = cell.sections["hardware"]
    assert hardware["driver"] == "robo" and hardware["drivers"] == {"force_torque": "feeler"}
    assert hardware["robo"] == {"host": "192.168.0.10"} and hardware["feeler"] == {"host": "sensor.lab"}
    assert hardware["devices"] == ["arm", "force_torque"]
    assert hardware["limits"] == {"force_cap_n": 60.0, "moved_mass_kg": 8.0}
    assert "# contact_stiffness_n_m:" in cell.text
    assert cell.workcell.hole_prior.pose_base_hole().rotation[:, 2] == pytest.approx([0, 0, -1])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--answer", "nmae=x"], "nmae: no question has that name; want name, arm"),
        (["--answer", "name"], "wants NAME=VALUE"),
        (["--answer", "name=A B"], "name: 'A B': want small letters"),
        (["--answer", "driver=robo"], "address: has no default; give it with --answer address=VALUE"),
        (["--answer", "driver=robo", "--answer", "address=192.168.0"], "want an address such as 192.168.0.10"),
        (["--answer", "driver=feeler"], "want one of simulated, robo, plugged"),
        (["--answers", "nowhere.yaml"], "cannot be read"),
        (["--answer", "camera_driver=pictures", "--answer", "camera_calibration=no.yaml"], "there is no such file"),
        (["--answer", "hole_position_m=1.5 0 0"], "does not reach the nominal hole"),
    ],
)
def test_a_given_answer_that_cannot_be_ends_it_and_names_what_would_do(
    run: Any, tmp_path: Path, arguments: list[str], words: str
) -> None:
    result = run("cell.yaml", "--yes", *arguments, drivers=REAL)
    assert result.exit_code == 1 and words in " ".join(result.output.split()), result.output
    assert not (tmp_path / "cell.yaml").exists()


def defaults_until(each: list[Question], key: str) -> dict[str, Any]:
    answers: dict[str, Any] = {}
    for question in each:
        if question.key == key:
            break
        if question.asked(answers):
            default = question.default(answers)
            assert default is not None
            answers[question.key] = question.read(default, answers)
    return answers


EACH = questions(REAL)
BEFORE = {question.key: defaults_until(EACH, question.key) for question in EACH}
ODD = st.one_of(
    st.text(max_size=60),
    st.sampled_from(["nan", "inf", "1e400", "-0", "0 0 0", "1,2,3", "none", "same", "\x00", "/", "..", "a.svg", ".yaml",
                     "1e-300 1 1", "[1, 2, 3]", "null", "0x10", "1_000", "١ ٢ ٣", "a" * 300, "300.1.1.1", "::1"]),
    st.lists(st.floats(), min_size=1, max_size=7).map(lambda values: " ".join(map(str, values))),
)  # fmt: skip


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from([question for question in EACH if not question.key.endswith("address")]), ODD)
def test_any_answer_is_taken_or_refused_and_what_is_taken_makes_a_file_that_reads(
    question: Question, text: str
) -> None:
    answers = dict(BEFORE[question.key])
    if question.key in ("home_joints_rad", "joint_stiffness_nm_rad"):
        answers["arm"] = {"name": "xb4"}
    try:
        answers[question.key] = question.read(text, answers)
    except InvalidAnswer as refused:
        assert str(refused)
        return
    for after in EACH[EACH.index(question) + 1 :]:
        if after.asked(answers):
            default = after.default(answers)
            if default is None:
                return  # of a real arm: its address
            try:
                answers[after.key] = after.read(default, answers)
            except InvalidAnswer:
                return  # the default does not go with it: the command says so
    cell_of_text(Path("cell.yaml"), cell_text(answers, Path("cell.yaml"), {}))


@settings(max_examples=60, deadline=None)
@given(ODD)
def test_any_address_is_taken_or_refused(text: str) -> None:
    question = next(one for one in EACH if one.key == "address")
    try:
        said = question.read(text, {"driver": "robo"})
    except InvalidAnswer as refused:
        assert str(refused)
        return
    assert yaml.safe_load(yaml.safe_dump({"host": said})) == {"host": said}
