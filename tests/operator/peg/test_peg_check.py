"""`crosspih peg check`: what it says of a drawing, in which form, and with which status."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.operator.cli.commands import app

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="60mm" viewBox="0 0 60 60">'
FIELDS = ["area_mm2", "width_mm", "height_mm", "corners", "symmetry", "left_out", "refusal"]


def _check(folder: Path, inside: str, *options: str) -> tuple[int, str]:
    path = folder / "Welle Ø40.svg"
    path.write_text(f"{HEAD}{inside}</svg>", encoding="utf-8")
    done = CliRunner().invoke(app, ["peg", "check", str(path), *options], env={"COLUMNS": "200"})
    return done.exit_code, done.stdout


def test_a_drawing_that_can_be_a_peg(tmp_path: Path) -> None:
    inside = '<path d="M 10 12 H 50 V 44 H 24 V 36 H 10 Z"/><text>40</text>'
    status, said = _check(tmp_path, inside, "--json", "--picture", str(tmp_path / "seen" / "peg.png"))
    assert status == 0
    assert json.loads(said) == {
        "area_mm2": 1168.0, "width_mm": 40.0, "height_mm": 32.0, "corners": 6, "symmetry": 1,
        "left_out": ["text: a text"], "refusal": None,
    }  # fmt: skip
    assert (tmp_path / "seen" / "peg.png").read_bytes().startswith(b"\x89PNG")
    status, said = _check(tmp_path, inside)
    assert status == 0
    assert "1168.000 mm²" in said and "text: a text" in said and "it can be a peg and a hole" in said


@pytest.mark.parametrize(
    ("inside", "words", "known"),
    [
        ('<path d="M0 0H30V30"/>', "close it", False),
        ('<rect width="0.4" height="0.3"/>', "a peg wants 1 mm or more; draw it larger, or mend", True),
        ('<rect x="-90" width="150" height="40"/>', "its rim reaches 76.1 mm from the axis", True),
        ('<path d="M0 0H40V40H24V12H16V40H0Z"/>', "the peg's axis", True),
        # teeth finer than the clearance and the chamfer leave
        ('<path d="M0 0H40V30h-19v-12h-.15v12h-20.85z"/>', "", True),
    ],
)
def test_a_drawing_that_cannot_says_why_in_one_line(tmp_path: Path, inside: str, words: str, known: bool) -> None:
    status, said = _check(tmp_path, inside, "--json")
    told = json.loads(said)
    assert status == 1 and list(told) == FIELDS
    assert words in told["refusal"] and "\n" not in told["refusal"] and "Ø40.svg" in told["refusal"]
    assert (told["area_mm2"] is not None) == known
    status, said = _check(tmp_path, inside)
    assert status == 1 and told["refusal"] in said


def test_a_drawing_that_is_not_there(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["peg", "check", str(tmp_path / "none.svg"), "--json"])
    assert done.exit_code == 1 and "there is no such drawing" in json.loads(done.stdout)["refusal"]
