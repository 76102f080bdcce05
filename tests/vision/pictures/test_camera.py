"""The simulated camera: its pixels lie where its projection says, and its bytes depend on the seed alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.scene.camera import SensorQuality, SimulatedScene
from services.hardware.drivers.simulated.scene.numpy_renderer import NumpyRenderer
from services.hardware.drivers.simulated.scene.scene_appearance import Appearance, Faults

WORKCELL = Workcell()
HOLE = WORKCELL.hole.shape(WORKCELL.peg.shape())
NOMINAL = WORKCELL.hole_prior.pose_base_hole()


@pytest.fixture(scope="module", params=["default", "numpy"])
def scene(request: pytest.FixtureRequest) -> Iterator[SimulatedScene]:
    renderer = NumpyRenderer() if request.param == "numpy" else None
    quality = SensorQuality(samples=4, blur_px=0.7, noise_grey=0.0)
    with SimulatedScene(HOLE, quality=quality, renderer=renderer) as opened:
        yield opened


def flat_light() -> Appearance:
    return Appearance(1.0, 0.3, 0.0, np.array([-1.0, 0.0, 0.0]), 0.2, 0.6, (0.0, 0.0))


def test_the_plates_edges_lie_where_the_projection_says(scene: SimulatedScene) -> None:
    """A renderer's corner sampling, uncorrected, would move both edges by 0.125 px."""
    # turned, so that an edge crosses many sub-pixels; these two edges show no side of the plate behind them
    pose = Pose(scene.rig.pose_base_camera.rotation, np.array([0.4, -0.3, 0.2])) @ Pose.from_rotvec(
        [0.0, 0.0, 0.1], [0.0, 0.0, 0.0]
    )
    pictures = scene.render_stereo(pose, None, np.random.default_rng(0), Faults(hole=False), flat_light())
    half = HOLE.plate_half_size_m
    cameras = (scene.rig.pose_base_camera, scene.rig.pose_base_right())
    for picture, camera in zip(pictures, cameras, strict=True):
        to_camera = camera.inverse() @ pose
        share = picture.astype(float) / float(picture.max())
        for axis, corners in (
            (0, [[half, -half, 0.0], [half, half, 0.0]]),
            (1, [[-half, half, 0.0], [half, half, 0.0]]),
        ):
            start, end = scene.rig.project(to_camera.apply(np.array(corners)))
            lines = np.arange(
                int(min(start[1 - axis], end[1 - axis])) + 15, int(max(start[1 - axis], end[1 - axis])) - 15
            )
            offsets = []
            for line in lines:
                expected = np.interp(line, *sorted_ends(start, end, axis))
                first = int(expected) - 6
                across = share[line] if axis == 0 else share[:, line]
                # a pixel's centre is an integer: the first one begins half a pixel before it
                offsets.append(first - 0.5 + across[first : first + 13].sum() - expected)
            assert abs(float(np.mean(offsets))) < 0.04


def sorted_ends(start: Array, end: Array, axis: int) -> tuple[list[float], list[float]]:
    """The two ends as (along, across) lists, along ascending."""
    low, high = sorted((start, end), key=lambda point: float(point[1 - axis]))
    return [low[1 - axis], high[1 - axis]], [low[axis], high[axis]]


def test_the_same_seed_gives_the_same_bytes_whatever_was_drawn_before(scene: SimulatedScene) -> None:
    first = scene.render_stereo(NOMINAL, None, np.random.default_rng(7))
    scene.render_stereo(
        NOMINAL, np.asarray(WORKCELL.home_joints_rad), np.random.default_rng(8), Faults(covered_arm=1, square=True)
    )
    second = scene.render_stereo(NOMINAL, None, np.random.default_rng(7))
    other = scene.render_stereo(NOMINAL, None, np.random.default_rng(9))
    assert np.array_equal(first, second)
    assert not np.array_equal(first, other)


def test_a_pair_is_what_a_camera_gives(scene: SimulatedScene) -> None:
    left, right = scene.render_stereo(NOMINAL, None, np.random.default_rng(1))
    for picture in (left, right):
        assert picture.shape == (480, 640)
        assert picture.dtype == np.uint8
    swapped = scene.render_stereo(NOMINAL, None, np.random.default_rng(1), Faults(swapped=True))
    assert np.array_equal(swapped[0], right)
    assert np.array_equal(swapped[1], left)


def test_noise_has_the_stated_size() -> None:
    with SimulatedScene(HOLE, quality=SensorQuality(noise_grey=3.0)) as noisy:
        left, _ = noisy.render_stereo(NOMINAL, None, np.random.default_rng(2), Faults(), flat_light_on_grey())
    assert float(np.std(left[:60, :200].astype(float))) == pytest.approx(3.0, abs=0.15)


def flat_light_on_grey() -> Appearance:
    return Appearance(1.0, 0.3, 0.2, np.array([-1.0, 0.0, 0.0]), 0.2, 0.6, (0.0, 0.0))


def test_the_overview_shows_the_cell(scene: SimulatedScene) -> None:
    picture = scene.render_overview(NOMINAL, np.asarray(WORKCELL.home_joints_rad), width=320, height=240)
    assert picture.shape == (240, 320, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50


@pytest.mark.parametrize("wrong", [{"light_scale": -1}, {"covered_arm": 4}])
def test_an_impossible_fault_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Faults(**wrong)
