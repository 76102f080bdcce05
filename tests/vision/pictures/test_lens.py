"""The simulated lens: it bends as OpenCV's does, and things are in its pictures where stereo projection says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.config import CameraSection, Workcell, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import DistortionModel
from services.hardware.config import HardwareConfig
from services.hardware.drivers.simulated.scene.camera import SensorQuality, SimulatedScene
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.hardware.drivers.simulated.scene.lens import Lens
from services.hardware.drivers.simulated.scene.scene_appearance import Appearance, Faults
from services.hardware.hosting import open_cell
from tests.vision.pictures.test_looks import stereo_of

WORKCELL = Workcell()
HOLE = WORKCELL.hole.shape(WORKCELL.peg.shape())
SHIPPED = load_cell("deploy/cells/default.yaml").workcell.camera
PINHOLE = CameraSection()
STRONG = CameraSection(distortion=(-0.25, 0.06, 0.002, -0.001), distortion_right=(0.15, -0.02, -0.001, 0.002, 0.01))
SMALL = st.floats(-0.08, 0.08)


@settings(deadline=None, max_examples=20)
@given(st.lists(SMALL, min_size=0, max_size=8))
def test_points_are_bent_as_opencv_bends_them(numbers: list[float]) -> None:
    numbers = [value * (0.05 if index in (2, 3) else 1.0) for index, value in enumerate(numbers)]
    lens = Lens(640, 480, 380.0, 385.0, 322.0, 241.0, tuple(numbers))
    points = np.random.default_rng(0).uniform([-0.2, -0.15, 0.25], [0.2, 0.15, 0.5], (50, 3))
    matrix = np.array([[380.0, 0.0, 322.0], [0.0, 385.0, 241.0], [0.0, 0.0, 1.0]])
    full = np.array([*numbers, *[0.0] * (8 - len(numbers))])
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, full)[0][:, 0]
    assert lens.project(points) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("section", [PINHOLE, SHIPPED, STRONG])
def test_a_pixel_sees_the_point_that_is_projected_into_it(section: CameraSection) -> None:
    for side in range(2):
        lens = StereoRig.of(section).lens(side)
        straight = lens.straight()
        slopes = np.stack([(straight[..., 0] - lens.cx) / lens.fx, (straight[..., 1] - lens.cy) / lens.fy], axis=-1)
        back = lens.project(np.concatenate([slopes, np.ones((*slopes.shape[:-1], 1))], axis=-1))
        columns, rows = np.meshgrid(np.arange(-1, lens.width + 1), np.arange(-1, lens.height + 1))
        assert np.abs(back - np.stack([columns, rows], axis=-1)).max() < 1e-4


@pytest.mark.parametrize("section", [PINHOLE, SHIPPED, STRONG])
def test_edges_lie_where_stereo_projection_says(section: CameraSection) -> None:
    """The plate's four outer edges, each far from the picture's middle, where a lens bends most."""
    rig = StereoRig.of(section)
    stereo = stereo_of(rig)
    half = HOLE.plate_half_size_m
    look = Appearance(1.0, 0.3, 0.0, np.array([-1.0, 0.0, 0.0]), 0.2, 0.6, (0.0, 0.0))
    # near, turned in its plane so that an edge crosses many sub-pixels, and square to the axis: no side shows
    pose_camera = Pose.from_rotvec([0.0, 0.0, 0.07], [0.025, 0.0, 0.155])
    pose = rig.pose_base_camera @ pose_camera
    with SimulatedScene(HOLE, rig, quality=SensorQuality(4, blur_px=0.5, noise_grey=0.0)) as scene:
        pictures = scene.render_stereo(pose, None, np.random.default_rng(0), Faults(hole=False), look)
    for side, picture in enumerate(pictures):
        share = picture.astype(float) / float(picture.max())
        offsets = []
        for axis, sign in ((0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)):
            along = np.linspace(-0.9, 0.9, 400) * half
            line = np.zeros((len(along), 3))
            line[:, axis], line[:, 1 - axis] = sign * half, along
            at = stereo.project(pose_camera.apply(line))[side]
            found = _offsets(share, at, axis, sign)
            assert abs(float(np.mean(found))) < 0.02, (side, axis, sign)
            offsets += found
        # a pixel's own steps are coarser than their mean
        assert float(np.std(offsets)) < 0.06


def _offsets(share: Array, line_px: Array, axis: int, sign: float) -> list[float]:
    """How far outside a line (n, 2) a bright area ends, px, in each row (axis 0) or column that the line crosses."""
    across, along = line_px[:, axis], line_px[:, 1 - axis]
    order = np.argsort(along)
    size = share.shape[1 - axis], share.shape[axis]
    found = []
    for row in range(int(np.ceil(along.min())) + 2, int(along.max()) - 2):
        if not 2 <= row < share.shape[axis] - 2:
            continue
        expected = float(np.interp(row, along[order], across[order]))
        values = share[row] if axis == 0 else share[:, row]
        first = int(np.rint(expected)) - 7
        if first < 0 or first + 15 > len(values):
            continue
        lit = float(values[first : first + 15].sum())
        ends = first - 0.5 + lit if sign > 0 else first + 14.5 - lit
        found.append(sign * (ends - expected))
    assert len(found) > 60, size
    return found


def test_the_calibration_says_what_the_lenses_do() -> None:
    cell = open_cell(load_cell("deploy/cells/default.yaml").workcell, HardwareConfig(), realtime=False)
    try:
        said = cell.camera.calibration()
    finally:
        cell.close()
    for model, numbers in zip((said.left, said.right), SHIPPED.distortions(), strict=True):
        assert model.distortion_model is DistortionModel.PLUMB_BOB
        assert model.distortion == numbers
    assert said.left.distortion != said.right.distortion
    pinhole = StereoRig.of(PINHOLE).models()
    assert all(model.distortion_model is DistortionModel.NONE and model.distortion == () for model in pinhole)


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        ("{distortion: [1, 2, 3, 4, 5, 6, 7, 8, 9]}", r"cell\.camera\.distortion: .*has 9 numbers; give at most 8"),
        ("{distortion: [-0.6]}", r"cell\.camera: .*distortion: .*bends back at 0\.\d\d; give numbers that hold"),
        ("{distortion_right: [0, -0.5]}", r"cell\.camera: .*distortion_right: .*bends back"),
        ("{distortion: wide}", r"cell\.camera\.distortion: "),
        ("{distortion: [.nan]}", r"cell\.camera\.distortion"),
    ],
)
def test_a_lens_that_cannot_be_is_refused_by_the_field(tmp_path: Path, camera: str, words: str) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(f"cell: {{camera: {camera}}}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=words):
        load_cell(path)


def test_an_older_cells_file_has_pinholes(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text("cell: {camera: {fx_px: 400}}\n", encoding="utf-8")
    camera: Any = load_cell(path).workcell.camera
    assert camera.distortions() == ((), ())
