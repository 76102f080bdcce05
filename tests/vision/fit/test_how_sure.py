"""What is believed of chamfers' light, and how wide a pose is told where a blurred rim says little."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.fit.climb import climb, rims
from services.vision.fit.shading import UNEVEN_SHADE, shade_belief
from services.vision.fit.solve import Doubts
from services.vision.fit.valley import with_valleys
from tests.vision.detect.test_detect import STEREO, truth_of
from tests.vision.fit.test_hard_pictures import HOLE
from tests.vision.pictures.drawn_pairs import Look, drawn_pair

COARSE, FINE = rims(HOLE)
TOLD = np.diag([0.02e-3, 0.02e-3, 0.1e-3, 2e-3, 2e-3, 1e-3]) ** 2


def told_of(look: Look) -> Array:
    """(6, 6): what is told of such a pair where TOLD is what the fit knows."""
    truth = truth_of(STEREO, look.seed)
    pictures = drawn_pair(STEREO, HOLE, truth, look)
    fit, _ = climb(pictures, COARSE, FINE, STEREO, [truth], Doubts())
    assert fit is not None
    return with_valleys(TOLD, pictures, FINE, STEREO, fit, Doubts())


def test_a_sharp_rim_is_told_as_surely_as_the_fit_is() -> None:
    np.testing.assert_array_equal(told_of(Look(seed=3)), TOLD)


def test_a_blurred_rim_is_told_as_widely_as_the_pictures_allow_aside() -> None:
    blurred = Look(chamfer=95.0, relief=0.8, light_rad=0.0, wall=25.0, bottom=15.0, blur_px=1.5, seed=8)
    told = told_of(blurred)
    more = np.linalg.eigvalsh((told - TOLD)[:2, :2])
    assert more.min() > -1e-15
    assert np.sqrt(np.diag(told)[:2].max()) > 2.0 * 0.02e-3


def test_chamfers_lit_by_far_light_cost_nothing_and_others_do() -> None:
    belief = shade_belief(FINE)
    first = np.unique(FINE.facing, return_index=True)[1]
    ways = FINE.outward[first].mean(axis=1)[:, :2]
    lit = 0.7 + 0.9 * ways[:, 0] - 0.4 * ways[:, 1]
    assert lit @ belief @ lit < 1e-9
    odd = np.array([1.0, -1.0, 1.0, -1.0])
    assert np.isclose(odd @ belief @ odd, 4.0 / UNEVEN_SHADE**2)


def test_chamfers_of_which_none_faces_one_way_are_believed_anything() -> None:
    seen = FINE.only(FINE.facing != 1)
    belief = shade_belief(seen)
    assert belief.shape == (4, 4)
    np.testing.assert_allclose(belief, 0.0, atol=1e-9)
