"""The hole is found by its outline alone: any outline, either polarity, texture, glints, covers, lenses, sizes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.config import CameraSection, PegDrawing, Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import DistortionModel
from crosspih_common.shapes import Hole, Outline
from services.hardware.drivers.simulated.scene.camera import SimulatedScene
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.hardware.drivers.simulated.scene.scene_appearance import Faults
from services.vision.detect import candidates
from services.vision.detect.picture_level import Level, Window
from services.vision.detect.rim_samples import RimSamples
from services.vision.stereo import Camera, StereoModel
from tests.vision.pictures.drawn_pairs import Look, drawn_pair
from tests.vision.pictures.plain_look import plain_look

NOMINAL = Workcell().hole_prior.pose_base_hole()
HALF_RANGES = np.asarray(Workcell().hole_prior.half_ranges(), float)
RIG = StereoRig.of(CameraSection())
STEREO = StereoModel.parallel(
    RIG.width, RIG.height, RIG.fx, RIG.fy, RIG.cx, RIG.cy, RIG.baseline_m, RIG.pose_base_camera
)
# a fit that looks 3 px to both sides starts well from there
NEAR_PX = 2.0


def hole_of(outline: str) -> Hole:
    corners_mm = {
        "L": [(-7, -7), (37, -7), (37, 7), (7, 7), (7, 37), (-7, 37)],
        "T": [(-7, -30), (7, -30), (7, 0), (22, 0), (22, 14), (-22, 14), (-22, 0), (-7, 0)],
    }
    if outline in corners_mm:
        return Hole(Outline.of(outline, np.array(corners_mm[outline], float) * 1e-3))
    cell = Workcell(peg=PegDrawing(outline=outline)) if outline != "cross" else Workcell()
    return cell.hole.shape(cell.peg.shape())


def truth_of(stereo: StereoModel, seed: int) -> Pose:
    """`pose_camera_hole`, drawn from the prior."""
    xi = np.random.default_rng(seed).uniform(-1.0, 1.0, 6) * HALF_RANGES
    return stereo.pose_base_camera.inverse() @ NOMINAL @ Pose.from_rotvec(xi[3:], xi[:3])


def off_px(stereo: StereoModel, hole: Hole, found: Pose, truth: Pose) -> float:
    """How far the found rim lies from the true one, across it, px: 95 % of it in both pictures are nearer."""
    samples = RimSamples.of(hole, 200, 0.0)
    seen, is_at = (stereo.project(pose.apply(samples.at(0.5))) for pose in (found, truth))
    along = stereo.project(truth.apply(samples.at(0.5) + 1e-4 * samples.along)) - is_at
    normal = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return float(np.quantile(np.abs(np.sum((seen - is_at) * normal, axis=-1)), 0.95))


def lens(k1: float) -> StereoModel:
    camera = replace(STEREO.left, distortion_model=DistortionModel.PLUMB_BOB, distortion=np.array([k1, *[0.0] * 7]))
    return replace(STEREO, left=camera, right=camera)


def resized(factor: float) -> Camera:
    camera = STEREO.left
    return replace(
        camera,
        width_px=round(camera.width_px * factor), height_px=round(camera.height_px * factor),
        fx_px=camera.fx_px * factor, fy_px=camera.fy_px * factor,
        cx_px=(camera.cx_px + 0.5) * factor - 0.5, cy_px=(camera.cy_px + 0.5) * factor - 0.5,
    )  # fmt: skip


LOOKS = {
    "dark hole": Look(),
    "bright hole": Look(face=40.0, chamfer=25.0, wall=90.0, bottom=180.0),
    "half bright": Look(face=110.0, chamfer=70.0, wall=60.0, bottom=10.0, half_bright=230.0),
    "clutter behind": Look(through=True, clutter=40, background=90.0),
    "milled": Look(marks=0.15, marks_rad=0.4),
    "glints": Look(glints=10, gradient=-0.5),
    "a third covered": Look(covered=0.33, seed=3),
    "dim": Look(face=14.0, chamfer=9.0, wall=5.0, bottom=2.0, background=2.0, noise=1.5),
    "sharp, no noise": Look(blur_px=0.3, noise=0.3),
    "blurred, noisy": Look(blur_px=1.5, noise=6.0),
}


@pytest.mark.parametrize("look", list(LOOKS))
def test_the_cross_is_found_however_it_looks(look: str) -> None:
    hole, truth = hole_of("cross"), truth_of(STEREO, 7)
    found = candidates(drawn_pair(STEREO, hole, truth, LOOKS[look]), STEREO, hole, NOMINAL, HALF_RANGES)
    assert off_px(STEREO, hole, found[0].pose_camera_hole, truth) < NEAR_PX
    assert found[0].score > (0.5 if look == "a third covered" else 0.7)


@pytest.mark.parametrize(
    ("outline", "bright"),
    [
        ("L", False),
        ("L", True),
        ("T", False),
        ("T", True),
        ("square", False),
        ("triangle", True),
        ("star", False),
        ("spline", True),
        ("keyway", False),
        ("round", True),
    ],
)
def test_any_outline_is_found(outline: str, bright: bool) -> None:
    hole, truth = hole_of(outline), truth_of(STEREO, 8)
    look = Look(face=60.0, chamfer=35.0, wall=120.0, bottom=200.0) if bright else Look()
    found = candidates(drawn_pair(STEREO, hole, truth, look), STEREO, hole, NOMINAL, HALF_RANGES)
    assert off_px(STEREO, hole, found[0].pose_camera_hole, truth) < NEAR_PX


@pytest.mark.parametrize(
    "stereo",
    [
        lens(-0.3),
        replace(STEREO, left=resized(0.5), right=resized(0.5)),
        replace(STEREO, right=resized(1.5), pose_left_right=Pose.from_rotvec([0.02, -0.2, 0.03], [0.08, 0.005, 0.01])),
    ],
    ids=["barrel", "320x240", "unequal and turned"],
)
def test_any_camera_will_do(stereo: StereoModel) -> None:
    hole, truth = hole_of("cross"), truth_of(stereo, 9)
    (left, right) = ((camera.width_px, camera.height_px) for camera in stereo.cameras)
    images = drawn_pair(stereo, hole, truth, Look(sizes=(left, right)))
    found = candidates(images, stereo, hole, NOMINAL, HALF_RANGES)
    assert off_px(stereo, hole, found[0].pose_camera_hole, truth) < NEAR_PX


@pytest.fixture(scope="module")
def scene() -> Iterator[SimulatedScene]:
    with SimulatedScene(hole_of("cross")) as opened:
        yield opened


@pytest.mark.parametrize(
    "faults", [Faults(), Faults(glare=150.0), Faults(light_scale=0.2), Faults(second_cross=True)], ids=repr
)
def test_the_cells_own_pictures(scene: SimulatedScene, faults: Faults) -> None:
    for seed in (61, 62):
        truth = truth_of(STEREO, seed)
        rng = np.random.default_rng(seed)
        images = scene.render_stereo(STEREO.pose_base_camera @ truth, None, rng, faults, plain_look(rng))
        found = candidates([i.astype(np.float32) for i in images], STEREO, scene.hole, NOMINAL, HALF_RANGES)
        assert off_px(STEREO, scene.hole, found[0].pose_camera_hole, truth) < NEAR_PX
        assert found[0].score > 0.8


def test_a_covered_arm_does_not_lead_astray(scene: SimulatedScene) -> None:
    truth, rng = truth_of(STEREO, 61), np.random.default_rng(61)
    images = scene.render_stereo(STEREO.pose_base_camera @ truth, None, rng, Faults(covered_arm=1), plain_look(rng))
    found = candidates([i.astype(np.float32) for i in images], STEREO, scene.hole, NOMINAL, HALF_RANGES)[0]
    assert off_px(STEREO, scene.hole, found.pose_camera_hole, truth) < NEAR_PX


@pytest.mark.parametrize("faults", [Faults(hole=False), Faults(hole=False, square=True)], ids=["blank", "square"])
def test_where_no_such_hole_is_little_speaks_for_it(scene: SimulatedScene, faults: Faults) -> None:
    rng = np.random.default_rng(5)
    images = scene.render_stereo(STEREO.pose_base_camera @ truth_of(STEREO, 5), None, rng, faults, plain_look(rng))
    found = candidates([i.astype(np.float32) for i in images], STEREO, scene.hole, NOMINAL, HALF_RANGES)
    assert found[0].score < 0.6


def test_pictures_that_show_nothing_support_nothing() -> None:
    empty = np.full((480, 640), 90.0, dtype=np.float32)
    found = candidates((empty, empty), STEREO, hole_of("cross"), NOMINAL, HALF_RANGES)
    assert found[0].score < 0.05


def test_a_rim_that_leaves_the_picture_is_found_by_the_rest() -> None:
    hole, truth = hole_of("cross"), truth_of(STEREO, 7)
    images = drawn_pair(STEREO, hole, truth, Look())
    middle = round(float(STEREO.project(truth.translation_m)[0, 0]))
    # the left camera's picture ends at the hole's middle
    cut = np.ascontiguousarray(images[0][:, :middle])
    found = candidates((cut, images[1]), STEREO, hole, NOMINAL, HALF_RANGES)[0]
    assert off_px(STEREO, hole, found.pose_camera_hole, truth) < 2.0 * NEAR_PX


def test_the_same_pictures_give_the_same_answer_to_the_last_bit() -> None:
    hole = hole_of("T")
    images = drawn_pair(STEREO, hole, truth_of(STEREO, 10), Look(marks=0.1))
    first, second = (candidates(images, STEREO, hole, NOMINAL, HALF_RANGES) for _ in range(2))
    assert [c.score for c in first] == [c.score for c in second]
    assert np.array_equal(first[0].pose_camera_hole.matrix(), second[0].pose_camera_hole.matrix())


@settings(max_examples=30, deadline=None)
@given(st.integers(3, 70), st.floats(0.3, 1.0), st.integers(0, 10**6))
def test_samples_lie_evenly_on_the_rim_of_any_outline(corners: int, least: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = 2.0 * np.pi * (np.arange(corners) + rng.uniform(-0.2, 0.2, corners)) / corners
    reach = 0.02 * rng.uniform(least, 1.0, corners)
    hole = Hole(Outline.of("any", np.column_stack([reach * np.cos(turn), reach * np.sin(turn)])), chamfer_m=1e-5)
    samples = RimSamples.of(hole, 90, 0.0005)
    for lines, points in ((hole.inner_rim_m(), samples.inner_m), (hole.outer_rim_m(), samples.outer_m)):
        run = np.roll(lines, -1, axis=0) - lines
        share = np.clip(np.einsum("mnj,nj->mn", points[:, None] - lines, run) / np.sum(run * run, axis=1), 0.0, 1.0)
        away = np.linalg.norm(points[:, None] - (lines + share[..., None] * run), axis=-1).min(axis=1)
        assert away.max() < 1e-9
    assert samples.smooth.sum(axis=1) == pytest.approx(np.ones(90))
    length = float(np.linalg.norm(np.roll(hole.inner_rim_m(), -1, axis=0) - hole.inner_rim_m(), axis=1).sum())
    gaps = np.linalg.norm(np.roll(samples.inner_m, -1, axis=0) - samples.inner_m, axis=1)
    assert gaps.max() < length / 90 + 6.1 * 0.0005


@pytest.mark.parametrize("factor", [1, 2, 3, 8])
def test_a_level_knows_where_its_pixels_lie(factor: int) -> None:
    v, u = np.mgrid[0:200, 0:300].astype(np.float32)
    at = np.array([151.3, 97.6])
    spot = 200.0 * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2.0 * 10.0**2)).astype(np.float32)
    level = Level.of(spot, Window.around(np.array([[100.0, 50.0], [210.0, 150.0]]), 3.0, factor), factor)
    rows, columns = np.mgrid[0 : level.grey.shape[0], 0 : level.grey.shape[1]]
    centroid = np.array([np.sum(columns * level.grey), np.sum(rows * level.grey)]) / level.grey.sum()
    assert level.to_level(at) == pytest.approx(centroid, abs=0.05)
