"""What noise hides inside a rim is asked again of a smoother picture, and noise itself is no proof of a hole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from services.vision.evidence.inside import Inside, seen_inside
from services.vision.evidence.verdict import DEPTHS_M, Evidence, judge
from services.vision.refusals import NotSeenInside
from tests.vision.evidence.test_prints import INK, refusal_of
from tests.vision.evidence.test_white_light import SOUND
from tests.vision.pictures.drawn_pairs import Look, drawn_pair
from tests.vision.test_doubts import HOLE, STEREO, TRUTH

NOISE = 1.9  # grey, of pixels that scatter by some 5, as smoothing leaves it


def inside_of(seen_noises: float, share: tuple[float, float], bright: float) -> Inside:
    """So many times the noise is seen, of which the face's plane leaves the first share and the deepest the last."""
    structure = seen_noises * NOISE
    return Inside(DEPTHS_M, np.linspace(*share, len(DEPTHS_M)) * structure, structure, NOISE, 1400, bright)


@pytest.mark.parametrize("flat", [False, True])
def test_what_is_faintly_seen_is_noise_where_a_smoother_picture_shows_it_in_the_plane(flat: bool) -> None:
    faint = Evidence(inside_of(1.22, (0.75, 0.5), 9.0), 0.6, 0.066, 0.0, True, flat_below_noise=flat)
    if flat:
        with pytest.raises(NotSeenInside):
            judge(faint, SOUND)
    else:
        judge(faint, SOUND)


@pytest.mark.parametrize("deep", [False, True])
def test_what_noise_hides_is_deep_where_a_smoother_picture_shows_it_off_the_plane(deep: bool) -> None:
    hidden = Evidence(inside_of(2.1, (0.89, 0.63), 17.0), 0.48, 0.108, 4.0, True, deep_below_noise=deep)
    if deep:
        judge(hidden, SOUND)
    else:
        with pytest.raises(NotSeenInside):
            judge(hidden, SOUND)


@pytest.mark.parametrize(("deeper", "hole"), [(3.0, False), (9.0, True)])
def test_a_chamfer_that_noise_could_make_is_no_proof(deeper: float, hole: bool) -> None:
    evidence = Evidence(inside_of(0.5, (0.98, 0.95), 5.0), 0.4, 0.04, deeper, True)
    if hole:
        judge(evidence, SOUND)
    else:
        with pytest.raises(NotSeenInside):
            judge(evidence, SOUND)


def test_a_bright_bottom_has_a_chamfer_above_it_as_well() -> None:
    pocket = Evidence(inside_of(2.39, (0.70, 0.65), 110.0), 1.9, 0.85, 134.0, True)
    with pytest.raises(NotSeenInside):
        judge(pocket, SOUND)
    judge(replace(pocket, black=0.3), SOUND)


def test_smoothing_halves_the_noise_and_leaves_the_walls() -> None:
    pose = STEREO.pose_base_camera.inverse() @ TRUTH
    images = drawn_pair(STEREO, HOLE, pose, Look(noise=5.0))
    fine, smoother = (
        seen_inside(images, STEREO, pose, HOLE.inner_rim_m(), DEPTHS_M, (25.0, 25.0), smooth_px)
        for smooth_px in (1.0, 2.0)
    )
    assert smoother.noise == pytest.approx(0.5 * fine.noise)
    assert smoother.structure > 0.7 * fine.structure and fine.noisy


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("chamfer", [INK.chamfer, INK.wall], ids=["by the inner line", "by the outer line"])
def test_ink_in_a_noisy_picture_is_no_hole(seed: int, chamfer: float) -> None:
    assert refusal_of(replace(INK, chamfer=chamfer, noise=6.0, seed=seed)) is not None
