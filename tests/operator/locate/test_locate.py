"""`crosspih locate` as a user calls it, on pictures in files, with the real worker process."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from services.hardware.drivers.simulated.scene.camera import SimulatedScene
from services.operator.cli.commands import app

WORKCELL = Workcell()
CELL = "deploy/cells/default.yaml"
PLACE = "left camera at (131.0, -240.6, 222.5) mm"
TRUTH = WORKCELL.hole_prior.pose_base_hole() @ Pose.from_rotvec([0.03, 0.05, -0.04], [0.003, 0.002, -0.005])
CAMERA = {"width_px": 640, "height_px": 480, "fx_px": 381.36, "fy_px": 381.36, "cx_px": 320.5, "cy_px": 240.5}
CALIBRATION = {
    "left": CAMERA, "right": CAMERA,
    "pose_left_right": {"position_m": [0.05, 0.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """left.png, right.png, dark.png and cal.yaml."""
    where = tmp_path_factory.mktemp("photos")
    with SimulatedScene(WORKCELL.hole.shape(WORKCELL.peg.shape())) as scene:
        pair = scene.render_stereo(TRUTH, None, np.random.default_rng(2))
    for side, picture in zip(("left", "right"), pair, strict=True):
        cv2.imwrite(str(where / f"{side}.png"), picture)
    cv2.imwrite(str(where / "dark.png"), pair[0] // 25)
    (where / "cal.yaml").write_text(yaml.safe_dump(CALIBRATION), encoding="utf-8")
    return where


def called(folder: Path, left: str, right: str, *options: str) -> Any:
    pictures = [",".join(str(folder / name) for name in given.split(",")) for given in (left, right)]
    return CliRunner().invoke(app, ["locate", *pictures, "--calibration", str(folder / "cal.yaml"), *options])


def test_the_hole_is_located_as_json(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CROSSPIH_CELL", raising=False)
    done = called(folder, "dark.png,left.png", "dark.png,right.png", "--json")
    assert done.exit_code == 0, done.output
    answer: dict[str, Any] = json.loads(done.stdout)
    assert list(answer) == ["located", "pose_base_hole", "covariance", "refusal", "time_s", "quality", "warnings"]
    delta = Pose.from_matrix(answer["pose_base_hole"]).inverse() @ TRUTH
    off = np.concatenate([delta.translation_m, delta.rotvec_rad()])
    assert answer["located"] and answer["refusal"] is None and answer["time_s"] > 0.0
    assert np.hypot(*off[:2]) < 0.3e-3
    assert off @ np.linalg.solve(np.array(answer["covariance"]), off) < 27.86


def test_people_get_a_table_and_the_pictures(folder: Path, tmp_path: Path) -> None:
    done = called(folder, "left.png", "right.png", "--annotated", str(tmp_path / "seen"), "--cell", CELL)
    assert done.exit_code == 0, done.output
    for said in (
        "position, mm",
        "one sd along",
        "quality: ",
        PLACE,
        "seen/left.png",
    ):
        assert said in done.stdout.replace("\n", "")
    assert cv2.imread(str(tmp_path / "seen" / "right.png")) is not None


def test_a_refusal_has_its_own_status_and_says_why(folder: Path) -> None:
    done = called(folder, "dark.png", "dark.png", "--json")
    assert done.exit_code == 3
    answer = json.loads(done.stdout)
    assert not answer["located"] and answer["pose_base_hole"] is None and answer["covariance"] is None
    assert answer["refusal"]["code"] and answer["refusal"]["text"]


@pytest.mark.parametrize(
    ("left", "right", "options", "said"),
    [
        ("none.png", "right.png", (), r"left: .*none\.png does not exist"),
        ("left.png", ".", (), "right: .* is no file"),
        ("left.png", "cal.yaml", (), r"right: .*cal\.yaml is not a picture"),
        ("left.png,dark.png", "right.png", (), "right: 2 pictures left and 1 right"),
        ("left.png", "right.png", ("--cell", "no-such.yaml"), r"no-such\.yaml"),
        ("left.png", "right.png", ("--calibration", "no-such.yaml"), r"no-such\.yaml cannot be read"),
    ],
)
def test_what_cannot_be_used_is_status_2_and_names_the_field(
    folder: Path, left: str, right: str, options: tuple[str, ...], said: str
) -> None:
    done = called(folder, left, right, *options)
    assert done.exit_code == 2
    assert done.stdout == ""
    assert re.search(said, done.stderr.replace("\n", " ")), done.stderr
