"""What is white or faint beside the rim: which fits are believed, and what tells a hole there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from hypothesis.extra.numpy import arrays

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from services.vision.checks import require_sound
from services.vision.evidence.inside import Inside
from services.vision.evidence.verdict import DEPTHS_M, Evidence, judge
from services.vision.fit.climb import rims
from services.vision.fit.medians import median, median_of_last
from services.vision.fit.quality import Quality
from services.vision.fit.rim import seen
from services.vision.fit.steps import profiles
from services.vision.refusals import NotSeenInside, PoorFit, ShallowPocket, TooBright
from tests.vision.detect.test_detect import STEREO, truth_of
from tests.vision.pictures.drawn_pairs import Look, drawn_pair

CELL = Workcell()
RIM = rims(CELL.hole.shape(CELL.peg.shape()))[1]
SOUND = Quality(
    step_grey=200.0,
    noise_grey=2.5,
    face_grey=110.0,
    support=np.full((2, RIM.shape[0]), 0.95),
    residual=0.02,
    inside=1.0,
    saturated=0.0,
    rim_saturated=0.8,
    inside_saturated=0.0,
    offset_px=np.zeros(2),
    offset_conflict=0.5,
    sizes_m=np.zeros(4),
    sizes_conflict=2.0,
    rough=0.0,
)


@given(arrays(float, some.tuples(some.integers(1, 3), some.integers(1, 9)), elements=some.floats(-1e6, 1e6)))
def test_medians_are_those_of_numpy(values: np.ndarray) -> None:
    assert median(values) == np.median(values)
    np.testing.assert_array_equal(median_of_last(values), np.median(values, axis=-1))


def test_a_white_chamfer_may_look_wider() -> None:
    require_sound(replace(SOUND, sizes_conflict=16.0), RIM)
    with pytest.raises(TooBright, match="expose less"):
        require_sound(replace(SOUND, sizes_conflict=16.0, inside_saturated=0.3), RIM)


def test_what_noise_leaves_is_no_reason_to_refuse() -> None:
    noisy = replace(SOUND, step_grey=28.0, noise_grey=2.5, residual=0.13, rim_saturated=0.0)
    require_sound(noisy, RIM)
    with pytest.raises(PoorFit):
        require_sound(replace(noisy, noise_grey=1.0), RIM)


def test_white_light_inside_and_white_chamfers_are_believed_where_nothing_pulls() -> None:
    require_sound(replace(SOUND, inside_saturated=0.8), RIM)
    with pytest.raises(TooBright):
        require_sound(replace(SOUND, inside_saturated=0.8, offset_conflict=5.0), RIM)


def test_white_where_the_face_should_be_counts() -> None:
    hole, truth = CELL.hole.shape(CELL.peg.shape()), truth_of(STEREO, 3)
    left, right = drawn_pair(STEREO, hole, truth, Look(face=80.0, chamfer=400.0, wall=400.0, bottom=400.0, relief=0.0))
    pictures = np.minimum(left, 255.0), np.minimum(right, 255.0)
    aside = truth @ Pose.from_translation([2.0e-3, 0.0, 0.0])
    shares = []
    for pose in (truth, aside):
        taken = profiles(pictures, seen(RIM, STEREO, pose), 0.7)
        white = (taken.grey > 250.0) & (taken.offsets_px < -1.0)
        shares.append(float(np.mean(taken.inside[white])) if white.any() else 0.0)
        assert not np.any(taken.inside[(taken.grey > 250.0) & (taken.offsets_px > 0.0)])
    assert shares[0] == 0.0 and shares[1] > 0.5


def test_greys_are_the_pixels_own_and_stand_where_the_pixels_are() -> None:
    rim = seen(RIM, STEREO, truth_of(STEREO, 3))
    row, column = np.mgrid[0 : STEREO.left.height_px, 0 : STEREO.left.width_px].astype(np.float32) / 4.0
    by_column, by_row = (profiles((number, number), rim, 0.7) for number in (column, row))
    at = 4.0 * np.stack([by_column.grey, by_row.grey], axis=-1)
    np.testing.assert_array_equal(at, np.rint(at))
    across = np.sum((at - rim.outer_px[..., None, :]) * rim.normal[..., None, :], axis=-1)
    np.testing.assert_allclose(by_column.offsets_px, across, atol=1e-6)


@pytest.mark.parametrize(("share", "pocket"), [((0.32, 0.13, 0.18), False), ((0.18, 0.13, 0.32), True)])
def test_a_bottom_between_two_planes_is_deep_where_the_deeper_one_explains_more(
    share: tuple[float, float, float], pocket: bool
) -> None:
    shares = np.full(len(DEPTHS_M), 0.75)
    at = int(np.flatnonzero(DEPTHS_M == 0.012)[0])
    shares[at - 1 : at + 2] = share
    inside = Inside(DEPTHS_M, shares * 14.0, 14.0, 1.4, 1400, 255.0)
    evidence = Evidence(inside, chamfer=0.0, black=1.7, deeper=0.0, chamfered=True)
    if pocket:
        with pytest.raises(ShallowPocket):
            judge(evidence, SOUND)
    else:
        judge(evidence, SOUND)


@pytest.mark.parametrize(("deep", "uneven", "hole"), [(0.43, 0.19, True), (0.6, 0.19, False), (0.43, 0.13, False)])
def test_what_is_faintly_seen_tells_where_a_deep_plane_explains_it(deep: float, uneven: float, hole: bool) -> None:
    noise, structure = 2.6, 4.4
    bright = float(np.hypot(structure, 0.5 * noise)) / uneven
    share = np.linspace(0.83, deep, len(DEPTHS_M))
    inside = Inside(DEPTHS_M, share * structure, structure, noise, 1400, bright)
    evidence = Evidence(inside, chamfer=2.0, black=0.14, deeper=0.2, chamfered=True)
    if hole:
        judge(evidence, SOUND)
    else:
        with pytest.raises(NotSeenInside):
            judge(evidence, SOUND)
