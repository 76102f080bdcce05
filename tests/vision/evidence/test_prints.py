"""A print is refused as a print where something says so, and a hole never is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from services.vision.evidence.inside import Inside
from services.vision.evidence.verdict import Evidence, judge
from services.vision.fit.quality import Quality
from services.vision.fit.solve import Doubts
from services.vision.locate import locate_rim
from services.vision.refusals import FlatPrint, NotSeenInside, VisionRefusal
from services.vision.second_look import Lighting as Light
from services.vision.second_look import next_look
from tests.vision.pictures.drawn_pairs import Look, drawn_pair
from tests.vision.test_doubts import HALF_RANGES, HOLE, NOMINAL, STEREO, TRUTH

INK = Look(face=170.0, chamfer=170.0, wall=22.0, bottom=22.0, relief=0.0, noise=1.5)


def refusal_of(look: Look) -> VisionRefusal | None:
    left, right = drawn_pair(STEREO, HOLE, STEREO.pose_base_camera.inverse() @ TRUTH, look)
    try:
        locate_rim(left, right, STEREO, HOLE, NOMINAL, HALF_RANGES, Doubts())
    except VisionRefusal as refusal:
        return refusal
    return None


@pytest.mark.parametrize("look", [INK, replace(INK, chamfer=22.0)], ids=["by the inner line", "by the outer line"])
def test_even_ink_in_an_outline_of_one_step_is_a_print_most_likely(look: Look) -> None:
    refusal = refusal_of(look)
    assert isinstance(refusal, FlatPrint), refusal
    assert "most likely a print" in str(refusal) and not refusal.certain
    # another light may still show a hole
    assert next_look(Light(), refusal.code, refusal.certain) == Light(lamp=1)
    assert next_look(Light(), refusal.code) is None


@pytest.mark.parametrize(
    "look",
    [
        Look(noise=1.5),
        Look(chamfer=170.0, relief=0.0, wall=60.0, bottom=15.0, noise=1.5),
        Look(chamfer=170.0, relief=0.0, wall=9.0, bottom=2.0, noise=1.5),
        Look(through=True, background=200.0, noise=1.5),
        Look(face=40.0, chamfer=12.0, wall=14.0, bottom=6.0, noise=1.5),
    ],
    ids=["usual", "one step, lit", "one step, dark", "bright behind", "black part"],
)
def test_a_hole_is_never_called_a_print(look: Look) -> None:
    assert not isinstance(refusal_of(look), FlatPrint)


def test_a_drawing_without_a_chamfer_has_one_step_and_proves_nothing() -> None:
    nothing = np.full(12, 0.02)
    inside = Inside(np.zeros(12), nothing, 0.3, 0.6, 900, 9.0)
    quality = Quality(
        120.0,
        1.5,
        150.0,
        np.ones((2, 12)),
        0.02,
        1.0,
        0.0,
        0.0,
        0.0,
        np.zeros(2),
        0.0,
        np.zeros(4),
        0.0,
        0.0,
    )
    for chamfered, name in ((True, FlatPrint), (False, NotSeenInside)):
        with pytest.raises(name):
            judge(Evidence(inside, 0.0, 0.06, 0.0, chamfered), quality)
