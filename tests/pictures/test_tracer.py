"""The path tracer draws where the projection says: areas and centroids of a disc, through any lens, in both cameras."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.operator.bench.pictures.camera.cameras import Pair, bent, cell_pair, toed_in
from services.operator.bench.pictures.camera.sensor import Sensor, seen
from services.operator.bench.pictures.scenes.scene import SceneSpec
from services.operator.bench.pictures.tracing.rendering import Care, render
from services.operator.bench.pictures.tracing.solids import disc, flat

pytest.importorskip("mitsuba", reason="the pictures' renderer is a development extra")

POSE = Pose.from_rotvec([0.1, -0.08, 0.2], [0.03, -0.01, 0.26])


def area_and_centroid(polygon: Array) -> tuple[float, Array]:
    """Of a polygon (n, 2), by its corners alone."""
    x, y = polygon.T
    after_x, after_y = np.roll(x, -1), np.roll(y, -1)
    cross = x * after_y - after_x * y
    area = 0.5 * float(cross.sum())
    centre = np.array([np.sum((x + after_x) * cross), np.sum((y + after_y) * cross)]) / (6.0 * area)
    return abs(area), centre


@pytest.mark.parametrize(
    "pair",
    [cell_pair(), toed_in(bent(cell_pair(), "plumb_bob", (-0.3, 0.12, 5e-4, -4e-4)), np.random.default_rng(1))],
    ids=["parallel", "toed-in and bent"],
)
def test_a_disc_lies_where_the_projection_says_to_a_hundredth_of_a_pixel(pair: Pair, tmp_path: Path) -> None:
    from services.operator.bench.pictures.tracing.tracer import Tracer, window_around

    shape = disc(0.02, 360)
    flat(shape, 0.0).at(POSE).write(tmp_path / "disc.ply")
    glowing = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    tracer = Tracer(
        {"disc": {"type": "ply", "filename": str(tmp_path / "disc.ply"), "bsdf": black, "emitter": glowing}}
    )
    ring = POSE.apply(np.column_stack([np.array(shape.exterior.coords[:-1]), np.zeros(360)]))
    for eye, lens in zip((Pose.identity(), pair.pose_left_right), pair.lenses, strict=True):
        inside = eye.inverse().apply(ring)
        window = window_around(inside[:, :2] / inside[:, 2:3], 2.0 * lens.fx_px, 18.0, 16)
        picture = seen([tracer.draw(eye, window, 3)], lens, Sensor()).astype(float)
        area, centre = area_and_centroid(lens.project(inside))
        v, u = np.mgrid[: lens.height_px, : lens.width_px]
        mass = picture.sum()
        assert abs(np.sqrt(mass) - np.sqrt(area)) / np.sqrt(np.pi) < 0.01  # its radius, px
        assert np.hypot(np.sum(picture * u) / mass - centre[0], np.sum(picture * v) / mass - centre[1]) < 0.01


def test_a_seed_gives_the_same_light_and_another_one_another(tmp_path: Path) -> None:
    spec = SceneSpec("milled", "box", clutter=True)
    first, again, other = (render(spec, Workcell(), cell_pair(), seed, Care(1, 1)) for seed in (5, 5, 6))
    assert np.array_equal(first.left[-1].light, again.left[-1].light)
    assert first.truth == again.truth
    assert first.truth["pose_base_hole"] != other.truth["pose_base_hole"]


def test_what_covers_the_rim_leaves_two_thirds_of_it() -> None:
    for cover in ("bar", "cable", "peg"):
        covered = render(SceneSpec(cover=cover), Workcell(), cell_pair(), 11, Care(1, 1)).truth["covered"]
        assert 0.05 <= max(covered) <= 0.34
