"""The hole's pose from rendered pairs: near the truth with honest limits, or a refusal that names the reason."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.ndimage import shift

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.scene.camera import GreyImage, SimulatedScene
from services.hardware.drivers.simulated.scene.scene_appearance import Faults
from services.vision.locate import Located, locate_rim
from services.vision.paper import locate_paper
from services.vision.refusals import (
    CutOff,
    NoCross,
    NotAStereoPair,
    OutsidePrior,
    PoorFit,
    TooDark,
    TwoCrosses,
    VisionRefusal,
    WrongImage,
)
from services.vision.stereo import StereoModel
from tests.vision.pictures.plain_look import plain_look

WORKCELL = Workcell()
HOLE = WORKCELL.hole.shape(WORKCELL.peg.shape())
NOMINAL = WORKCELL.hole_prior.pose_base_hole()
HALF_RANGES = np.asarray(WORKCELL.hole_prior.half_ranges(), float)
CHI2_6_95 = 12.59
CHI2_6_9999 = 27.86


@pytest.fixture(scope="module")
def scene() -> Iterator[SimulatedScene]:
    with SimulatedScene(HOLE) as opened:
        yield opened


@pytest.fixture(scope="module")
def stereo(scene: SimulatedScene) -> StereoModel:
    rig = scene.rig
    return StereoModel.parallel(
        rig.width, rig.height, rig.fx, rig.fy, rig.cx, rig.cy, rig.baseline_m, rig.pose_base_camera
    )


def draw_hole(rng: np.random.Generator) -> Pose:
    """A true hole about the nominal one, uniform within the prior."""
    xi = rng.uniform(-1.0, 1.0, 6) * HALF_RANGES
    return NOMINAL @ Pose.from_rotvec(xi[3:], xi[:3])


def shot(scene: SimulatedScene, seed: int, faults: Faults | None = None) -> tuple[Pose, GreyImage, GreyImage]:
    """Truth and a pair of pictures of a seed."""
    rng = np.random.default_rng(seed)
    truth = draw_hole(rng)
    left, right = scene.render_stereo(truth, None, rng, faults or Faults(), plain_look(rng))
    return truth, left, right


def error_of(found: Located, truth: Pose) -> Array:
    """The error (6,) in the found hole's frame, m and rad."""
    delta = found.pose_base_hole.inverse() @ truth
    return np.concatenate([delta.translation_m, delta.rotvec_rad()])


def test_random_poses_are_found_and_the_covariance_is_honest(scene: SimulatedScene, stereo: StereoModel) -> None:
    seeds = range(3000, 3012)
    errors, distances = [], []
    for seed in seeds:
        truth, left, right = shot(scene, seed)
        found = locate_rim(left, right, stereo, HOLE, NOMINAL, HALF_RANGES)
        errors.append(error_of(found, truth))
        distances.append(float(errors[-1] @ np.linalg.solve(found.covariance, errors[-1])))
        assert np.all(np.linalg.eigvalsh(found.covariance) > 0.0)
    error = np.array(errors)
    assert np.median(np.hypot(error[:, 0], error[:, 1])) < 0.1e-3
    assert np.median(np.hypot(error[:, 3], error[:, 4])) < np.deg2rad(0.6)
    assert np.median(np.abs(error[:, 5])) < np.deg2rad(0.1)
    # honest both ways: no truth is far outside, and the stated spread is not padded so that all lie near its middle
    assert max(distances) < CHI2_6_9999
    assert np.mean(np.array(distances) < CHI2_6_95) >= 10 / 12
    assert np.median(distances) > 0.3


def test_the_same_pictures_give_the_same_answer_to_the_last_bit(scene: SimulatedScene, stereo: StereoModel) -> None:
    pictures = [shot(scene, 3020)[1:] for _ in range(2)]
    first, second = (locate_rim(left, right, stereo, HOLE, NOMINAL, HALF_RANGES) for left, right in pictures)
    assert np.array_equal(pictures[0], pictures[1])
    assert np.array_equal(first.pose_base_hole.matrix(), second.pose_base_hole.matrix())
    assert np.array_equal(first.covariance, second.covariance)


def test_the_annotated_pictures_mark_the_region_in_colour(scene: SimulatedScene, stereo: StereoModel) -> None:
    _, left, right = shot(scene, 3021)
    for locate in (locate_rim, locate_paper):
        found = locate(left, right, stereo, HOLE, NOMINAL, HALF_RANGES)
        for picture in (found.annotated_left, found.annotated_right):
            assert picture.shape == (480, 640, 3)
            red = (picture[..., 0].astype(int) - picture[..., 1]) > 150
            assert 100 < np.count_nonzero(red) < 5000


@pytest.mark.parametrize(
    ("faults", "refusal"),
    [
        (Faults(light_scale=0.05), TooDark),
        (Faults(hole=False), NoCross),
        (Faults(hole=False, square=True), NoCross),
        (Faults(swapped=True), NotAStereoPair),
    ],
    ids=["dark", "no hole", "square", "swapped"],
)
@pytest.mark.parametrize("seed", [4000, 4001])
def test_a_fault_is_refused_by_its_name(
    scene: SimulatedScene, stereo: StereoModel, faults: Faults, refusal: type[VisionRefusal], seed: int
) -> None:
    _, left, right = shot(scene, seed, faults)
    for locate in (locate_rim, locate_paper):
        with pytest.raises(refusal) as caught:
            locate(left, right, stereo, HOLE, NOMINAL, HALF_RANGES)
        assert caught.value.code == refusal.code
        assert any(character.isdigit() for character in str(caught.value))


@pytest.mark.parametrize("faults", [Faults(covered_arm=arm) for arm in range(4)] + [Faults(glare=150.0)])
@pytest.mark.parametrize("seed", [4100, 4101])
def test_a_disturbed_rim_is_refused_or_still_true(
    scene: SimulatedScene, stereo: StereoModel, faults: Faults, seed: int
) -> None:
    truth, left, right = shot(scene, seed, faults)
    try:
        found = locate_rim(left, right, stereo, HOLE, NOMINAL, HALF_RANGES)
    except VisionRefusal:
        return
    error = error_of(found, truth)
    assert np.hypot(error[0], error[1]) < 1.5e-3
    assert error @ np.linalg.solve(found.covariance, error) < CHI2_6_9999


def test_another_hole_beside_where_it_should_be_does_not_disturb(scene: SimulatedScene, stereo: StereoModel) -> None:
    truth, left, right = shot(scene, 4000, Faults(second_cross=True))
    error = error_of(locate_rim(left, right, stereo, HOLE, NOMINAL, HALF_RANGES), truth)
    assert np.hypot(error[0], error[1]) < 0.2e-3
    with pytest.raises(TwoCrosses):
        locate_paper(left, right, stereo, HOLE, NOMINAL, HALF_RANGES)


def test_a_square_beside_the_cross_does_not_disturb(scene: SimulatedScene, stereo: StereoModel) -> None:
    truth, left, right = shot(scene, 4200, Faults(square=True))
    error = error_of(locate_rim(left, right, stereo, HOLE, NOMINAL, HALF_RANGES), truth)
    assert np.hypot(error[0], error[1]) < 0.4e-3


@pytest.mark.parametrize("rows", [-0.5, 0.5, 1.0])
def test_a_right_picture_moved_along_its_columns_is_refused_or_doubted(
    scene: SimulatedScene, stereo: StereoModel, rows: float
) -> None:
    truth, left, right = shot(scene, 4300)
    moved = np.clip(np.rint(shift(right.astype(float), (rows, 0.0), order=3, mode="nearest")), 0, 255)
    # the pose can take up a part of the shift: then the covariance must hold it
    try:
        found = locate_rim(left, moved.astype(np.uint8), stereo, HOLE, NOMINAL, HALF_RANGES)
    except (NotAStereoPair, PoorFit):
        return
    error = error_of(found, truth)
    assert error @ np.linalg.solve(found.covariance, error) < CHI2_6_9999


def test_a_cross_at_the_edge_of_a_picture_is_cut_off(scene: SimulatedScene, stereo: StereoModel) -> None:
    _, left, right = shot(scene, 4301)
    # both pictures of a rig turned so far that the cross lies across the right edge
    columns = 235
    moved = [np.roll(image, columns, axis=1) for image in (left, right)]
    for image in moved:
        image[:, :columns] = image[:, columns : columns + 1]
    with pytest.raises((CutOff, NoCross)):
        locate_rim(moved[0], moved[1], stereo, HOLE, NOMINAL, HALF_RANGES)


def test_a_hole_outside_the_prior_is_refused(scene: SimulatedScene, stereo: StereoModel) -> None:
    rng = np.random.default_rng(4302)
    away = NOMINAL @ Pose.from_translation([0.0, -0.02, 0.0])
    left, right = scene.render_stereo(away, None, rng, appearance=plain_look(rng))
    with pytest.raises(OutsidePrior):
        locate_rim(left, right, stereo, HOLE, NOMINAL, HALF_RANGES)


def test_a_picture_of_another_size_is_refused(scene: SimulatedScene, stereo: StereoModel) -> None:
    _, left, right = shot(scene, 4303)
    with pytest.raises(WrongImage, match="right"):
        locate_rim(left, np.ascontiguousarray(right[:, :600]), stereo, HOLE, NOMINAL, HALF_RANGES)


def test_the_papers_method_gives_a_position_and_claims_no_orientation(
    scene: SimulatedScene, stereo: StereoModel
) -> None:
    truth, left, right = shot(scene, 4304)
    found = locate_paper(left, right, stereo, HOLE, NOMINAL, HALF_RANGES)
    assert np.linalg.norm(error_of(found, truth)[:2]) < 5e-3
    assert np.allclose(np.diag(found.covariance)[3:], HALF_RANGES[3:] ** 2 / 3.0)


def test_cameras_in_one_place_are_refused_naming_the_field() -> None:
    picture = np.full((480, 640), 128, dtype=np.uint8)
    stereo = StereoModel.parallel(640, 480, 381.0, 381.0, 320.0, 240.0, 0.0, Pose.identity())
    workcell = Workcell()
    hole = workcell.hole.shape(workcell.peg.shape())
    prior = workcell.hole_prior
    with pytest.raises(VisionRefusal, match="pose_left_right: both cameras stand in one place"):
        locate_rim(picture, picture, stereo, hole, prior.pose_base_hole(), np.asarray(prior.half_ranges()))
