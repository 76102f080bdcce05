"""The fit by the visible edges.

An object that covers an edge has steps of its own a few pixels beside the rim. Its profiles get little weight, but they
are all far off in the same way in both pictures. So they pull at the pose, and leaving out one edge of one picture does
not reveal it. An edge whose profiles mostly do not look like the rim carries no information on it, and the pose is
fitted again without that edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.fit.climb import Rival, climb
from services.vision.fit.quality import support_of
from services.vision.fit.rim import Rim
from services.vision.fit.solve import Doubts, Fit, Images, iterate, start_state
from services.vision.stereo import StereoModel

# share of an edge's profiles that look like the rim in both pictures: below it a part of the edge is hidden; share of
# all profiles, and of the edges, in either picture: below it there is no rim to fit
MIN_SEEN, MIN_RIM = 0.8, 0.5
ROUNDS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Uncovered:
    """The fit, the `rim` that it used, the poses beside it, and the share of each edge of the whole rim that looks like
    one at its pose, `support` (2, G)."""

    fit: Fit
    rim: Rim
    rivals: list[Rival]
    support: Array


def fit_uncovered(
    images: Images, coarse: Rim, fine: Rim, stereo: StereoModel, starts: Sequence[Pose], doubts: Doubts
) -> Uncovered | None:
    """The best fit about one place, by the edges of the rim that nothing hides; None where no pose explains them."""
    fit, rivals = climb(images, coarse, fine, stereo, starts, doubts)
    if fit is None:
        return None
    support, shown = support_of(fit)
    found = Uncovered(fit, fine, rivals, support)
    kept = np.ones(fine.shape[0], dtype=bool)
    for _ in range(ROUNDS):
        # a saturated edge has no step that could pull
        seen = kept & np.any((support >= MIN_SEEN) | (shown < MIN_SEEN), axis=0)
        few = min(support.mean(axis=1).min(), np.mean(support > 0.5, axis=1).min(), seen.mean()) < MIN_RIM
        if few or seen.sum() == kept.sum():
            break
        start = [found.fit.state.pose_camera_hole]
        again, rivals = climb(images, coarse.only(seen), fine.only(seen), stereo, start, doubts)
        if again is None:
            break
        support, shown = _whole_support(images, fine, stereo, again, doubts)
        found, kept = Uncovered(again, fine.only(seen), rivals, support), seen
    return found


def _whole_support(images: Images, fine: Rim, stereo: StereoModel, fit: Fit, doubts: Doubts) -> tuple[Array, Array]:
    """(2, G) each, for all edges, with the rim placed by a fit of some of them."""
    state = start_state(fine, fit.state.pose_camera_hole, float(np.median(fit.state.blur_px2[:, [0, 2]])))
    return support_of(iterate(images, fine, stereo, state, doubts)[1])
