"""What is doubted of the drawing and of the calibration: it makes the pose less sure, and lets more through."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import pytest

from crosspih_common.config import CameraSection, HoleTolerance, Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraModel, DistortionModel
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.vision.config import CalibrationDoubt
from services.vision.doubts import doubts_of
from services.vision.fit.climb import rims
from services.vision.fit.solve import Doubts
from services.vision.hidden import hidden_parts
from services.vision.locate import Located, locate_rim
from services.vision.refusals import NotTheDrawing
from services.vision.stereo import Camera, StereoModel
from services.vision.straightness import left_over, lenses_of
from tests.vision.pictures.drawn_pairs import Floats, Look, drawn_pair

WORKCELL = Workcell()
HOLE = WORKCELL.hole.shape(WORKCELL.peg.shape())
NOMINAL = WORKCELL.hole_prior.pose_base_hole()
HALF_RANGES = np.asarray(WORKCELL.hole_prior.half_ranges(), float)
RIG = StereoRig.of(CameraSection())
STEREO = StereoModel.parallel(
    RIG.width, RIG.height, RIG.fx, RIG.fy, RIG.cx, RIG.cy, RIG.baseline_m, RIG.pose_base_camera
)
TRUTH = NOMINAL @ Pose.from_rotvec([0.05, -0.06, 0.03], [0.003, -0.002, 0.004])
CHI2_6_9999 = 27.86


def bent(k1: float) -> StereoModel:
    """The cell's cameras with a barrel's distortion."""
    names = ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")
    told = CameraModel(**{name: getattr(CameraSection(), name) for name in names},
                       distortion_model=DistortionModel.PLUMB_BOB, distortion=(k1,))  # fmt: skip
    camera = Camera.of(told)
    return StereoModel(camera, camera, STEREO.pose_left_right, STEREO.pose_base_camera)


@lru_cache
def pictures(k1: float = 0.0, larger_m: float = 0.0) -> tuple[Floats, Floats]:
    """A pair through a lens of that k1, of a hole that is larger on every side."""
    stereo = bent(k1) if k1 else STEREO
    drawing = WORKCELL.hole.model_copy(update={"clearance_m": WORKCELL.hole.clearance_m + larger_m})
    hole = drawing.shape(WORKCELL.peg.shape())
    return drawn_pair(stereo, hole, stereo.pose_base_camera.inverse() @ TRUTH, Look(noise=1.0))


def located(seen: tuple[Floats, Floats], doubts: Doubts, stereo: StereoModel = STEREO) -> Located:
    return locate_rim(*seen, stereo, HOLE, NOMINAL, HALF_RANGES, doubts)


def error_of(found: Located) -> Array:
    delta = found.pose_base_hole.inverse() @ TRUTH
    return np.concatenate([delta.translation_m, delta.rotvec_rad()])


def test_the_defaults_of_the_cells_file_are_those_of_the_fit() -> None:
    usual = doubts_of(HoleTolerance(), CalibrationDoubt())
    assert all(getattr(usual, name) == getattr(Doubts(), name) for name in Doubts.__slots__)
    told = doubts_of(HoleTolerance(size_m=1e-4, edge_break_m=3e-5, chamfer_m=4e-5), CalibrationDoubt(offset_sd_px=0.1))
    assert told.sds() == pytest.approx([5e-5, 3e-5, 1e-4, 1e-4])
    assert told.offset_sd_px == 0.1


@pytest.mark.parametrize(
    "more",
    [Doubts(outer_sd_m=3e-4, inner_sd_m=3e-4, size_sd_m=5e-4, offset_sd_px=0.2), Doubts(offset_sd_px=0.2)],
    ids=["all", "calibration"],
)
def test_a_larger_doubt_makes_the_covariance_larger(more: Doubts) -> None:
    usual, doubted = (located(pictures(), doubts).covariance for doubts in (Doubts(), more))
    assert np.linalg.slogdet(doubted)[1] > np.linalg.slogdet(usual)[1] + 0.02
    # what the edges differ by is another fit's, and a few percent either way
    assert np.all(np.diag(doubted) > 0.85 * np.diag(usual))


def test_a_hole_that_is_not_the_drawings_is_one_with_a_larger_tolerance() -> None:
    seen = pictures(larger_m=0.3e-3)
    with pytest.raises(NotTheDrawing, match="near edges"):
        located(seen, Doubts())
    found = located(seen, doubts_of(HoleTolerance(size_m=0.25e-3), CalibrationDoubt()))
    error = error_of(found)
    assert error @ np.linalg.solve(found.covariance, error) < CHI2_6_9999
    assert found.diagnostics["near_off_mm"] == pytest.approx(0.3, abs=0.1)


def test_a_distortion_that_nobody_told_is_within_the_covariance_and_one_that_is_told_is_not_doubted() -> None:
    seen = pictures(k1=-0.03)
    found, sure, told = (
        located(seen, Doubts()),
        located(seen, Doubts(k1_untold_sd=0.0)),
        located(seen, Doubts(), bent(-0.03)),
    )
    error = error_of(found)
    assert np.array_equal(found.pose_base_hole.matrix(), sure.pose_base_hole.matrix())
    assert abs(error[2]) > 0.9 * np.sqrt(sure.covariance[2, 2])  # what it costs where it is not doubted
    assert error @ np.linalg.solve(found.covariance, error) < CHI2_6_9999
    assert np.all(np.linalg.eigvalsh(found.covariance - sure.covariance) > -1e-12)
    assert abs(error_of(told)[2]) < 0.5 * abs(error[2])
    assert told.diagnostics["lens_depth_sd_mm"] < 0.1 * found.diagnostics["lens_depth_sd_mm"]


def test_straight_edges_warn_of_a_lens_only_where_no_chance_explains_it() -> None:
    rng = np.random.default_rng(0)

    def edges(k1: float, count: int) -> Array:
        sd = np.full(count, 0.02)
        return np.stack([k1 + sd * rng.normal(size=count), sd], axis=1)

    few, straight, bowed = left_over(edges(-0.1, 2)), left_over(edges(0.0, 16)), left_over(edges(-0.05, 16))
    assert few is None
    assert straight is not None and not straight.sure and abs(straight.k1) < 3.0 * straight.sd
    assert bowed is not None and bowed.sure and bowed.k1 == pytest.approx(-0.05, abs=0.02)


def test_a_round_thing_is_not_taken_for_a_bent_lens() -> None:
    for radius, centre in ((120, (320, 240)), (210, (320, 240)), (230, (300, 260))):
        disc = np.full((480 * 4, 640 * 4), 40.0, dtype=np.float32)
        cv2.circle(disc, (centre[0] * 4, centre[1] * 4), radius * 4, 180.0, -1)
        small = cv2.resize(disc, (640, 480), interpolation=cv2.INTER_AREA)
        light: Floats = np.asarray(cv2.GaussianBlur(small, (0, 0), 0.7), dtype=np.float32)
        seen = lenses_of((light, light), STEREO.cameras)
        assert not seen.sure and not seen.warnings()


def test_what_is_hidden_of_the_rim_is_named_by_the_drawing() -> None:
    rim = rims(HOLE)[1]
    middle = rim.outer_m[..., :2].mean(axis=1)
    support = np.ones((2, rim.shape[0]))
    assert hidden_parts(support, rim) == ""
    support[0, middle[:, 0] > 0.012] = 0.1
    assert hidden_parts(support, rim) == "in the left picture the rim at +x"
    support[1, (middle[:, 1] < -0.012) | (middle[:, 0] < -0.02)] = 0.0
    assert hidden_parts(support, rim).endswith("in the right picture the rim at -y and -x")
    support[1] = 0.0
    assert hidden_parts(support, rim).endswith("in the right picture nearly all of it")
