"""The small set that comes with the code, and pairs in a folder: what is read is what was made."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from crosspih_common.config import Workcell
from crosspih_common.errors import CrosspihError
from crosspih_common.messages import CameraCalibration
from services.operator.bench.commands import app
from services.operator.bench.pictures.judging.plain_pnp import plain_pose
from services.operator.bench.pictures.judging.table import table_of
from services.operator.bench.pictures.judging.verdicts import (
    PicturesReport,
    PictureVerdict,
    figures,
    figures_of,
    least_off,
)
from services.operator.bench.pictures.kept import shots, store
from services.operator.bench.pictures.kept.sets import ROWS
from services.operator.bench.pictures.tracing.tracer import LightLevel

SMALL = Path(__file__).parent / "set"
WORKCELL = Workcell()
HOLE = WORKCELL.hole.shape(WORKCELL.peg.shape())


def only(row: str) -> shots.Shot:
    return shots.wanted_from(SMALL, [row], 1)[0].load()


def test_the_small_set_has_every_row_and_is_small() -> None:
    wanted = shots.wanted_from(SMALL, None, None)
    assert {one.row for one in wanted} == set(ROWS)
    assert len(wanted) >= 40
    assert sum(path.stat().st_size for path in SMALL.rglob("*")) < 8e6


@pytest.mark.parametrize("row", ["matt", "imx273", "k1_-0.3", "turned", "print_shaded", "mirrored"])
def test_a_pair_has_the_cameras_sizes_and_a_calibration_that_vision_reads(row: str) -> None:
    shot = only(row)
    calibration = CameraCalibration.model_validate(shot.calibration)
    for picture, camera in ((shot.left, calibration.left), (shot.right, calibration.right)):
        assert picture.shape == (camera.height_px, camera.width_px)
    assert (shot.pose_base_hole is None) == (not shot.is_the_hole) == (row in ("print_shaded", "mirrored"))
    assert np.array_equal(shot.left, only(row).left)


def test_the_plain_recipe_finds_the_matt_hole_where_the_truth_is() -> None:
    """An independent method: a wrong axis, row order or pixel centre in the pictures would move it by more."""
    shot = only("matt")
    found = plain_pose((shot.left, shot.right), shot.calibration, HOLE, WORKCELL.hole_prior.pose_base_hole())
    assert found is not None and shot.pose_base_hole is not None
    off = figures_of(least_off(found, shot.pose_base_hole, 4))
    assert off["lateral_mm"] < 1.0
    assert abs(off["depth_mm"]) < 4.0
    assert off["tilt_deg"] < 6.0


def test_pairs_as_png_read_as_they_were_written(tmp_path: Path) -> None:
    truths: dict[str, object] = {}
    made = [only(row) for row in ("k1_-0.05_untold", "outlines", "blank", "imx273")]
    for shot in made:
        shots.write_pair(shot, tmp_path, truths)
    (tmp_path / shots.TRUTH).write_text(json.dumps(truths))
    for one, shot in zip(shots.wanted_from(tmp_path, None, None), made, strict=True):
        read = one.load()
        assert np.array_equal(read.left, shot.left) and np.array_equal(read.right, shot.right)
        assert (read.calibration, read.peg, read.is_the_hole) == (shot.calibration, shot.peg, shot.is_the_hole)


def test_a_folder_without_calibration_is_the_default_cells(tmp_path: Path) -> None:
    truths: dict[str, dict[str, object]] = {}
    shots.write_pair(only("matt"), tmp_path, truths)
    name = next(iter(truths))
    kept = {key: truths[name][key] for key in ("is_the_hole", "pose_base_hole")}
    (tmp_path / shots.TRUTH).write_text(json.dumps({name: kept | {"distortion_k1": -0.05, "gamma": "sRGB"}}))
    read = shots.wanted_from(tmp_path, None, None)[0].load()
    assert read.calibration["left"]["fx_px"] == WORKCELL.camera.fx_px
    assert read.calibration["right"]["distortion"][0] == -0.05
    assert read.calibration["left"]["gamma"] == "srgb"


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(CrosspihError, match="bench pictures"):
        shots.wanted_from(tmp_path, None, None)
    with pytest.raises(CrosspihError, match="no row 'shiny'"):
        shots.wanted_from(SMALL, ["shiny"], None)


@pytest.mark.parametrize(("small", "most", "off"), [(False, 4.0, 5e-4), (True, 1.5, 5e-3)])
def test_a_store_keeps_the_light(small: bool, most: float, off: float, tmp_path: Path) -> None:
    light = np.linspace(0.0, 1.4, 240, dtype=np.float32).reshape(12, 20)
    level = LightLevel(381.36, -10, 4, light)
    store.save(tmp_path / "a.npz", store.Rendered((level,), (level, level), {"seed": 3}), small)
    read = store.load(tmp_path / "a.npz")
    assert (len(read.left), len(read.right), read.truth) == (1, 2, {"seed": 3})
    assert (read.left[0].focal_px, read.left[0].left, read.left[0].top) == (381.36, -10, 4)
    assert np.max(np.abs(read.left[0].light - light)) < off * np.sqrt(most)


def test_the_bench_judges_a_row_by_the_vision_process() -> None:
    ran = CliRunner().invoke(
        app, ["vision", "--pictures", str(SMALL), "--rows", "matt,blank", "--pairs", "1", "--json"]
    )
    assert ran.exit_code == 0, ran.output
    report = json.loads(ran.stdout)
    assert [row["row"] for row in report["rows"]] == ["matt", "blank"]
    assert report["all"]["pairs"] == 2
    assert report["rows"][1]["holes"] == 0
    assert report["each"][0]["time_s"] > 0.0


def test_pictures_that_are_nowhere_end_with_one_line(tmp_path: Path) -> None:
    ran = CliRunner().invoke(app, ["vision", "--pictures", str(tmp_path)])
    assert ran.exit_code == 1
    assert "bench pictures" in ran.stderr


def test_a_mixture_of_renderers_is_said() -> None:
    """Scenes that are there are kept when the renderer's code changes, so the table must say so."""
    verdicts = [
        PictureVerdict(name="a", row="matt", is_the_hole=True, located=False, rendered_by=by) for by in ("x", "x", "")
    ]

    def caption(some: list[PictureVerdict]) -> str:
        row = figures("matt", some)
        return str(table_of(PicturesReport(pictures="p", rows=[row], all=row, each=some)).caption)

    assert "A MIXTURE of pictures: 2 rendered by x, 1 rendered by code that is not said" in caption(verdicts)
    assert "MIXTURE" not in caption(verdicts[:2])
