"""The `surroundings` of a cell's file: what is read, what is refused by its field, and the page's example."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.collision import CollisionModel
from crosspih_common.config import load_cell
from crosspih_common.errors import ConfigError

PAGE = Path(__file__).resolve().parents[2] / "docs" / "surroundings.md"
CUBE = """v 0 0 0
v 100 0 0
v 100 100 0
v 0 100 0
v 0 0 100
v 100 0 100
v 100 100 100
v 0 100 100
f 1 3 2
f 1 4 3
f 5 6 7
f 5 7 8
f 1 2 6
f 1 6 5
f 2 3 7
f 2 7 6
f 3 4 8
f 3 8 7
f 4 1 5
f 4 5 8
"""
NOTHING = "floor_height_m: null, stand_radius_m: null"


def model_of(folder: Path, surroundings: str) -> CollisionModel:
    file = folder / "cell.yaml"
    file.write_text(f"cell:\n  surroundings: {{{surroundings}}}\n", encoding="utf-8")
    return CollisionModel(load_cell(file).workcell)


def test_the_example_of_the_page_is_a_cell(tmp_path: Path) -> None:
    (example,) = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    (tmp_path / "cell.yaml").write_text(example, encoding="utf-8")
    (tmp_path / "feeder.obj").write_text(CUBE, encoding="utf-8")
    workcell = load_cell(tmp_path / "cell.yaml").workcell
    model = CollisionModel(workcell)
    declared = {"the floor", "the camera post", "the air tank", "the feeder", "the walkway"}
    assert set(model.obstacles) == {"the fixture", "the fixture's stand", *declared}
    assert model.clearance(workcell.home_joints_rad).distance_m > model.margin_m


@pytest.mark.parametrize(
    ("surroundings", "says"),
    [
        ("boxes: [{name: post, size_m: [0.1, 0.1, 0.0]}]", r"surroundings\.boxes\.0\.size_m\.2: .*greater than 0"),
        ("boxes: [{size_m: [0.1, 0.1, 0.1]}]", r"cell\.surroundings\.boxes\.0\.name: Field required"),
        ("boxes: [{name: post, size: 1}]", r"cell\.surroundings\.boxes\.0\.size: no such setting; remove it or mend"),
        ("keep_out: [{name: the floor, size_m: [1, 1, 1]}]", r"keep_out\.0\.name 'the floor' is taken; give it a name"),
        ("meshes: [{name: a, file: a.step}]", r"surroundings\.meshes\.0: .*a\.step.*want a mesh that ends in \.stl"),
        ("margin_m: 0.0", r"cell\.surroundings\.margin_m: .*greater than or equal to 0\.002"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_by_its_field(tmp_path: Path, surroundings: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        model_of(tmp_path, surroundings)


@pytest.mark.parametrize(("content", "says"), [(None, "is not there; put the mesh"), ("rubbish", "is no mesh")])
def test_a_mesh_that_cannot_be_read_is_named(tmp_path: Path, content: str | None, says: str) -> None:
    if content is not None:
        (tmp_path / "part.stl").write_text(content, encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"cell\.surroundings\.meshes\.0\.file: .*part\.stl {says}"):
        model_of(tmp_path, "meshes: [{name: the part, file: part.stl}]")


@pytest.mark.parametrize("hull", ["true", "false"])
def test_a_mesh_is_as_far_as_the_box_of_its_shape(tmp_path: Path, hull: str) -> None:
    (tmp_path / "cube.obj").write_text(CUBE, encoding="utf-8")
    placed = "rotvec_rad: [0.3, -0.2, 0.5]"
    mesh = (
        f"meshes: [{{name: cube, file: cube.obj, scale: 0.001, hull: {hull}, position_m: [0.3, 0.2, 0.2], {placed}}}]"
    )
    corner = model_of(tmp_path, f"{mesh}, {NOTHING}")
    turn = load_cell(tmp_path / "cell.yaml").workcell.surroundings.meshes[0].pose()
    middle = turn.apply([0.05, 0.05, 0.05]).tolist()
    box = model_of(
        tmp_path, f"boxes: [{{name: cube, size_m: [0.1, 0.1, 0.1], position_m: {middle}, {placed}}}], {NOTHING}"
    )
    for joints in (np.zeros(6), np.full(6, 0.4)):
        found, known = corner.distances_m(joints), box.distances_m(joints)
        for part in ("arm link 2", "arm link 4", "the tool", "the peg"):
            if hull == "true" or known[part, "cube"] > 0.0:
                assert found[part, "cube"] == pytest.approx(known[part, "cube"], abs=1e-6)
            else:  # triangles have no inside
                assert found[part, "cube"] < 0.0
