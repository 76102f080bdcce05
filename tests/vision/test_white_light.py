"""What is white or faint beside the rim: which fits are believed, and what tells a hole there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some
from hypothesis.extra.numpy import arrays

from crosspih_common.config import Workcell
from services.vision.checks import require_sound
from services.vision.evidence.inside import Inside
from services.vision.evidence.verdict import DEPTHS_M, Evidence, judge
from services.vision.fit.climb import rims
from services.vision.fit.medians import median, median_of_last
from services.vision.fit.quality import Quality
from services.vision.refusals import NotSeenInside, TooBright

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
