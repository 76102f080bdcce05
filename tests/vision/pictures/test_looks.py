"""How the simulated plate looks: marks stand still on it, each thing is in its place, the seed decides it all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from crosspih_common.config import CameraSection, Workcell, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, PoseData
from services.hardware.config import HardwareConfig
from services.hardware.drivers.simulated.config import AppearanceConfig
from services.hardware.drivers.simulated.scene.camera import SensorQuality, SimulatedScene
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.hardware.drivers.simulated.scene.finish import marks, texels
from services.hardware.drivers.simulated.scene.numpy_renderer import NumpyRenderer
from services.hardware.drivers.simulated.scene.renderer import Renderer, View, open_renderer
from services.hardware.drivers.simulated.scene.scene_appearance import FINISHES, Appearance, Faults
from services.hardware.drivers.simulated.scene.scene_mesh import box_mesh
from services.hardware.hosting import open_cell
from services.vision.stereo import StereoModel

WORKCELL = Workcell()
HOLE = WORKCELL.hole.shape(WORKCELL.peg.shape())
HALF_M = HOLE.plate_half_size_m
NOMINAL = WORKCELL.hole_prior.pose_base_hole()
LENSES = CameraSection(distortion=(-0.15, 0.04, 0.001, -0.0005), distortion_right=(-0.13, 0.03, -0.0004, 0.001))
RIG = StereoRig.of(LENSES)
PLAIN = Appearance(0.8, 0.3, 0.1, np.array([-1.0, 0.0, 0.0]), 0.2, 0.5, (0.0, 0.0), marks_seed=5)


@pytest.fixture(scope="module")
def scene() -> Iterator[SimulatedScene]:
    with SimulatedScene(HOLE, RIG, quality=SensorQuality(4, blur_px=0.3, noise_grey=0.0)) as opened:
        yield opened


def stereo_of(rig: StereoRig) -> StereoModel:
    """What vision makes of what the cameras say of themselves."""
    left, right = rig.models()
    beside = Pose.from_translation([rig.baseline_m, 0.0, 0.0])
    return StereoModel.of(
        CameraCalibration(
            left=left, right=right, pose_left_right=PoseData.of(beside),
            pose_base_camera=PoseData.of(rig.pose_base_camera),
        )
    )  # fmt: skip


def seen_at(pictures: Any, points_base_m: Array) -> Array:
    """Grey levels (2, ...) of points (..., 3), left and right."""
    stereo = stereo_of(RIG)
    pixels = stereo.project(stereo.pose_base_camera.inverse().apply(points_base_m.reshape(-1, 3)))
    greys = [sampled(picture, at) for picture, at in zip(pictures, pixels, strict=True)]
    return np.array(greys).reshape(2, *points_base_m.shape[:-1])


def sampled(picture: Any, places: Array) -> Array:
    """Of (n, 2) columns and rows, (n,)."""
    return np.asarray(map_coordinates(np.asarray(picture, float), [places[:, 1], places[:, 0]], order=1))


def on_face(step_m: float, reach: float = 0.9) -> Array:
    line = np.arange(-reach * HALF_M, reach * HALF_M, step_m)
    x, y = np.meshgrid(line, line)
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def alike(one: Array, other: Array) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


@pytest.mark.parametrize("finish", ["milled", "turned", "cast"])
def test_both_cameras_see_the_same_marks_in_the_same_places(scene: SimulatedScene, finish: Any) -> None:
    look = replace(PLAIN, finish=finish, finish_strength=0.3)
    pictures = scene.render_stereo(NOMINAL, None, np.random.default_rng(0), Faults(hole=False), look)
    points = on_face(0.4e-3)
    left, right = seen_at(pictures, NOMINAL.apply(points))
    moved = seen_at(pictures, NOMINAL.apply(points + np.array([2.4e-3, 1.6e-3, 0.0])))[1]
    assert alike(left, right) > 0.85
    assert alike(left, moved) < 0.6
    # and they are those that the seed makes, where the plate has them; a pixel covers some 0.7 mm
    made = cv2.GaussianBlur(marks(finish, HALF_M, look.marks_seed), (0, 0), 2.5)
    at = texels(points[..., :2], HALF_M).reshape(-1, 2)
    assert alike(left, sampled(made, at)) > 0.85


def test_marks_are_on_the_face_alone(scene: SimulatedScene) -> None:
    plain, marked = (
        scene.render_stereo(NOMINAL, None, np.random.default_rng(0), Faults(), look)
        for look in (PLAIN, replace(PLAIN, finish="blasted", finish_strength=0.3))
    )
    difference = np.abs(np.subtract(plain, marked, dtype=float))
    x, y, _ = np.moveaxis(on_face(0.5e-3, 0.98), -1, 0)
    reach = HOLE.opening().corners_m
    inside = cv2.pointPolygonTest
    rim = reach.astype(np.float32).reshape(-1, 1, 2)
    away_m = np.array([inside(rim, (float(a), float(b)), True) for a, b in zip(x.ravel(), y.ravel(), strict=True)])
    points = NOMINAL.apply(np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3))
    changed = seen_at(difference, points)
    # what is 2 mm inside the outline is a chamfer, a wall or the background
    assert np.all(changed[:, away_m > 2e-3] < 1.0)
    assert float(np.mean(changed[:, away_m < -2e-3] > 3.0)) > 0.6
    corner = np.array([[0.0, 1.3 * HALF_M, 0.0], [0.0, -1.3 * HALF_M, 0.0]])
    assert np.all(seen_at(difference, NOMINAL.apply(corner)) == 0.0)


def test_a_renderer_says_whose_each_sample_is() -> None:
    for renderer in (open_renderer(), NumpyRenderer()):
        _check_owners(renderer)
        renderer.close()


def _check_owners(renderer: Renderer) -> None:
    numbers = [renderer.add(box_mesh((half, half, 0.1))) for half in (0.8, 0.3)]
    for number, z_m in zip(numbers, (-4.0, -2.0), strict=True):
        renderer.place(number, Pose.from_translation([0.0, 0.0, z_m]))
    near, far = 0.1, 10.0
    lens = np.diag([1.0, 1.0, -(far + near) / (far - near), 0.0])
    lens[2, 3], lens[3, 2] = -2.0 * far * near / (far - near), -1.0
    ahead = np.eye(4).ravel().tolist()
    view = View(200, 200, ahead, lens.T.ravel().tolist(), np.array([0.0, 0.0, 1.0]), 0.2, 0.6)
    body = renderer.draw(view).body
    assert body[100, 100] == numbers[1]
    # 0.8 at 3.9 m reaches 20.5 of 100 samples, 0.3 at 1.9 m reaches 15.8
    assert body[100, 100 + 18] == numbers[0]
    assert body[100, 100 + 23] < 0 and body[0, 0] < 0


def test_shine_is_not_the_same_from_both_sides(scene: SimulatedScene) -> None:
    def sides(shine: float) -> Array:
        look = replace(PLAIN, finish="ground", shine=shine, to_light=np.array([-0.8, 0.6, 0.0]))
        pictures = scene.render_stereo(NOMINAL, None, np.random.default_rng(0), Faults(hole=False), look)
        return seen_at(pictures, NOMINAL.apply(on_face(2e-3)))

    paint, metal = sides(0.0), sides(0.8)
    assert np.allclose(paint[0], paint[1], atol=1.01)
    ratio = metal[0] / metal[1]
    assert float(np.abs(ratio - 1.0).max()) > 0.05
    # the exposure keeps the level that it has on paint
    assert float(metal.mean()) == pytest.approx(float(paint.mean()), rel=0.05)


def test_glints_lie_along_the_rim(scene: SimulatedScene) -> None:
    """A lamp straight ahead of the face: every edge can mirror it into one of the cameras."""
    look = replace(PLAIN, to_light=-NOMINAL.rotation[:, 2], background_grey=0.0)
    plain, bright = (
        scene.render_stereo(NOMINAL, None, np.random.default_rng(0), Faults(), replace(look, edge_glints=grey))
        for grey in (0.0, 120.0)
    )
    difference = np.subtract(bright, plain, dtype=float)
    assert difference.min() > -1.5 and difference.max() > 20.0
    stereo = stereo_of(RIG)
    rim = HOLE.outer_rim_m()
    share = np.linspace(0.0, 1.0, 60, endpoint=False)[None, :, None]
    line = (rim[:, None] * (1.0 - share) + np.roll(rim, -1, axis=0)[:, None] * share).reshape(-1, 3)
    pixels = stereo.project(stereo.pose_base_camera.inverse().apply(NOMINAL.apply(line)))
    for changed, at in zip(difference, pixels, strict=True):
        rows, columns = np.nonzero(changed > 3.0)
        away = np.linalg.norm(np.stack([columns, rows], axis=-1)[:, None] - at, axis=-1).min(axis=1)
        assert len(rows) and away.max() < 2.5


def test_a_through_hole_shows_what_is_behind_and_a_blind_one_its_bottom(scene: SimulatedScene) -> None:
    look = replace(PLAIN, background="bright", background_grey=0.9)
    middle = NOMINAL.apply(np.zeros((1, 3)))
    grey = {}
    for name, share in (("through", None), ("blind", 0.9)):
        shown = replace(look, bottom_share=share, bottom_grey=0.2)
        pictures = scene.render_stereo(NOMINAL, None, np.random.default_rng(0), Faults(), shown)
        # straight through the bore, as the left camera sees it
        stereo = stereo_of(RIG)
        at = stereo.project(stereo.pose_base_camera.inverse().apply(middle))[0, 0].astype(int)
        grey[name] = float(pictures[0][at[1], at[0]])
    assert grey["through"] == pytest.approx(0.9 * 255.0, abs=1.5)
    # ambient and diffuse light straight on
    lit = 0.2 * 255.0 * (0.2 + 0.5 * float(-NOMINAL.rotation[:, 2] @ PLAIN.to_light))
    assert grey["blind"] == pytest.approx(lit, abs=2.0)


def test_things_behind_stand_still_in_the_cell(scene: SimulatedScene) -> None:
    """One wall: some distance brings the left picture's background onto the right one's."""
    look = replace(PLAIN, background="cluttered")
    away = NOMINAL @ Pose.from_translation([0.0, 0.0, -50.0])
    pictures = scene.render_stereo(away, None, np.random.default_rng(0), Faults(), look)
    u, v = np.meshgrid(np.linspace(-0.4, 0.4, 80), np.linspace(-0.4, 0.4, 80))
    eye = RIG.pose_base_camera
    agreement = []
    for distance_m in np.arange(0.4, 1.5, 0.01):
        left, right = seen_at(pictures, eye.apply(np.stack([u, v, np.ones_like(u)], axis=-1) * distance_m))
        agreement.append(float(np.mean(np.abs(left - right))))
    assert min(agreement) < 0.6 and max(agreement) > 3.0


def test_the_same_seed_gives_the_same_bytes_in_another_scene() -> None:
    taken = []
    for seed in (3, 3, 4):
        with SimulatedScene(HOLE, RIG) as opened:
            taken.append(opened.render_stereo(NOMINAL, None, np.random.default_rng(seed)))
    assert np.array_equal(taken[0], taken[1])
    assert not np.array_equal(taken[0], taken[2])


def test_another_lamp_leaves_the_marks_where_they_are(scene: SimulatedScene) -> None:
    look = replace(PLAIN, finish="cast", finish_strength=0.3, to_light=np.array([-0.8, 0.6, 0.0]))
    one, other = (
        scene.render_stereo(NOMINAL, None, np.random.default_rng(0), Faults(hole=False), lit)[0]
        for lit in (look, look.under_another_lamp(1))
    )
    points = NOMINAL.apply(on_face(0.5e-3))
    assert alike(seen_at((one, one), points)[0], seen_at((other, other), points)[0]) > 0.95


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32), st.sampled_from(sorted(FINISHES)), st.sampled_from(["through", "blind"]))
def test_what_is_fixed_is_kept_and_changes_nothing_else(seed: int, finish: Any, hole: Any) -> None:
    drawn = Appearance.draw(np.random.default_rng(seed))
    fixed = Appearance.draw(
        np.random.default_rng(seed), AppearanceConfig(finish=finish, hole=hole, finish_strength=0.2, face_glints=7)
    )
    assert (fixed.finish, fixed.finish_strength, fixed.face_glints) == (finish, 0.2, 7)
    assert (fixed.bottom_share is not None) == (hole == "blind")
    # how shiny it is goes by the finish
    changed = {"finish", "finish_strength", "face_glints", "bottom_share", "shine"}
    for field in fields(Appearance):
        if field.name not in changed:
            assert np.array_equal(getattr(drawn, field.name), getattr(fixed, field.name)), field.name


def test_seeds_differ_in_all_that_is_drawn() -> None:
    looks = [Appearance.draw(np.random.default_rng(seed)) for seed in range(200)]
    assert {look.finish for look in looks} == set(FINISHES)
    assert {look.background for look in looks} == {"dark", "grey", "bright", "cluttered"}
    assert {look.bottom_share is None for look in looks} == {True, False}
    assert all(0.4 <= blur <= 1.2 for look in looks for blur in look.blur_px)
    assert all(0.5 <= look.noise_grey <= 4.0 for look in looks)


@pytest.mark.parametrize(
    ("appearance", "words"),
    [
        ("{finish: polished}", "appearance.finish: .*'matt', 'milled', 'ground', 'turned', 'cast' or 'blasted'"),
        ("{finish_strength: 0.9}", "appearance.finish_strength: .*less than or equal to 0.4"),
        ("{shine: -1}", "appearance.shine: .*greater than or equal to 0"),
        ("{face_gradient: 2}", "appearance.face_gradient: "),
        ("{picture_gradient: .nan}", "appearance.picture_gradient: "),
        ("{edge_glints: 1000}", "appearance.edge_glints: "),
        ("{face_glints: 1.5}", "appearance.face_glints: .*integer"),
        ("{background: blue}", "appearance.background: .*'dark', 'grey', 'bright' or 'cluttered'"),
        ("{hole: half}", "appearance.hole: .*'through' or 'blind'"),
        ("{bottom_depth_m: 0.03}", "bottom_depth_m: only a blind hole has a bottom; say hole: blind, or leave it out"),
        ("{glow: 1}", "appearance.glow: no such setting"),
    ],
)
def test_a_look_that_cannot_be_is_refused_by_the_field(tmp_path: Path, appearance: str, words: str) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(f"hardware: {{simulated: {{camera: {{appearance: {appearance}}}}}}}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"cell.yaml: hardware\.simulated\.camera\..*{words}"):
        load_cell(path).section("hardware", HardwareConfig)


@pytest.mark.parametrize("depth_m", [0.0005, 0.2])
def test_a_bottom_that_is_not_in_the_plate_is_refused(depth_m: float) -> None:
    told = {"simulated": {"camera": {"appearance": {"hole": "blind", "bottom_depth_m": depth_m}}}}
    with pytest.raises(ConfigError, match=r"appearance\.bottom_depth_m: .* no more than the plate's 0\.05 m"):
        open_cell(WORKCELL, HardwareConfig.model_validate(told), realtime=False)
