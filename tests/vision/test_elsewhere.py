"""Another outline, most of which is the drawing's, is told by where its edges are; what covers an edge is not one."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.config import PegDrawing, Workcell
from crosspih_common.shapes import Hole
from services.vision.fit.solve import Doubts
from services.vision.locate import locate_rim
from services.vision.refusals import NotTheDrawing, VisionRefusal
from tests.vision.pictures.drawn_pairs import Look, drawn_pair
from tests.vision.test_doubts import HALF_RANGES, HOLE, NOMINAL, STEREO, TRUTH

SEEN_FROM = STEREO.pose_base_camera.inverse() @ TRUTH


def changed(**moved_mm: float) -> Hole:
    """The drawing's cross with whole arms longer: `right=3.0` is the arm at +x."""
    corners = np.asarray(Workcell().peg.shape().outline.corners_m, dtype=float).copy()
    far = np.abs(corners).max()
    for name, axis, sign in (("right", 0, 1.0), ("left", 0, -1.0), ("up", 1, 1.0), ("down", 1, -1.0)):
        end = np.isclose(sign * corners[:, axis], far)
        corners[end, axis] += sign * moved_mm.get(name, 0.0) * 1e-3
    peg = PegDrawing(outline="another", corners_m=tuple((float(x), float(y)) for x, y in corners))
    return Workcell(peg=peg).hole.shape(peg.shape())


@pytest.mark.parametrize(
    "arms", [{"right": 3.0}, {"up": 4.5}, {"left": 7.0}, {"right": -4.0, "left": -4.0, "up": -4.0, "down": -4.0}]
)
def test_an_outline_with_other_arms_is_not_the_drawing(arms: dict[str, float]) -> None:
    left, right = drawn_pair(STEREO, changed(**arms), SEEN_FROM, Look())
    with pytest.raises(VisionRefusal) as refused:
        locate_rim(left, right, STEREO, HOLE, NOMINAL, HALF_RANGES, Doubts())
    assert refused.type.__name__ in ("NotTheDrawing", "NotEnoughRim", "PoorFit")


def test_it_is_said_how_far_the_edge_is_off() -> None:
    left, right = drawn_pair(STEREO, changed(right=3.0), SEEN_FROM, Look())
    with pytest.raises(NotTheDrawing, match=r"by \+(2\.[89]|3\.[012]) mm, in the face's plane"):
        locate_rim(left, right, STEREO, HOLE, NOMINAL, HALF_RANGES, Doubts())


@pytest.mark.parametrize("seed", [1, 4])
def test_a_cover_is_no_other_outline(seed: int) -> None:
    left, right = drawn_pair(STEREO, HOLE, SEEN_FROM, Look(covered=0.2, seed=seed))
    try:
        locate_rim(left, right, STEREO, HOLE, NOMINAL, HALF_RANGES, Doubts())
    except VisionRefusal as refusal:
        assert not isinstance(refusal, NotTheDrawing)
