"""Decides whether a fit is a hole, by three kinds of evidence, the strongest first.

1. What is seen inside does not lie in the face's plane, nor a little below it (parallax).
2. The rim has a chamfer: two steps whose middle grey is neither the face's nor the bore's.
3. The inside is blacker than ink: light that goes in does not come out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.evidence.flat_picture import deeper_by
from services.vision.evidence.inside import NOISY_GREY, Inside, seen_inside
from services.vision.fit.quality import Quality
from services.vision.fit.rim import Rim, Rimmed
from services.vision.fit.solve import Doubts, Fit, Images
from services.vision.refusals import FlatPrint, NotSeenInside, ShallowPocket
from services.vision.stereo import StereoModel

DEPTHS_M = np.array([0.0, 0.0005, 0.001, 0.0015, 0.002, 0.003, 0.004, 0.006, 0.008, 0.012, 0.018, 0.03])
# the inside counts as seen above this many noises; as plainly seen; and above this share of the step
SEEN_NOISES, PLAIN_NOISES, SEEN_SHARE = 1.1, 2.3, 0.006
# further looks with more smoothing, one sd, px. SMOOTHER, in noisy pictures: plainly seen, with at least this share not
# explained by the face's plane: deep. SMOOTHEST, where the noise exceeds this grey and the inside is faint: seen above
# this many noises, with a share below NOT_IN_PLANE not explained: it lies in the face's plane
SMOOTHER_PX, SMOOTHER_DEEP = 2.0, 0.8
SMOOTHEST_PX, SMOOTHEST_GREY, SMOOTHEST_NOISES = 3.0, 0.8, 2.0
# a plane explains the inside if it leaves a share below EXPLAINED; it does not above the others, for an inside that is
# plainly or faintly seen
EXPLAINED, NOT_EXPLAINED, FAINTLY_NOT_EXPLAINED = 0.35, 0.5, 0.72
NOISY_NOT_EXPLAINED = 0.65  # in a noisy picture, where the noise of both pictures is subtracted
BRIGHT_NOT_EXPLAINED = 0.75  # where the inside is as bright as the bottom of a pocket, which shines as the face does
FAINTLY_BETTER, PLAINLY_BETTER = 0.08, 0.15
# a faint inside counts only if it is more uneven, as a share of its grey, than shades of ink and reflections in glossy
# ink; beside an inside more uneven than INK_UNEVEN, the chamfer is not a printed one
FAINTLY_UNEVEN, INK_UNEVEN = 0.26, 0.15
# gain of a deep plane over the face's plane that counts for a less uneven inside which is no reflection; ink stays
# below
FAINTLY_DEEP = 0.28
# difference between two planes that counts, share of the structure
BETTER = 0.12
# a glossy print reflects distant objects: its inside is at most this uneven, and a deep plane leaves at least this
# share of the residual of the face's plane
MIRRORED_UNEVEN, MIRRORED = 0.15, 0.6
# a bottom DEEP_M below a face, with the same surface, is this share as bright
BOTTOM_SHARE = 0.5
# from DEEP_M on it is a bottom, a wall or the background; up to FLAT_M it is the face itself
DEEP_M, FLAT_M = 0.012, 0.0008
# a plane in the middle of a lit wall explains it best, by at least this much more than the face's plane
WALL_M, WALL_BETTER = 0.004, 0.1
# log likelihood ratio of a chamfer that goes down against one drawn on the face: required where the inside may be ink,
# and where it is plainly seen
MIN_DEEPER, DEEPER_PLAIN = 20.0, 50.0
# the same in a noisy picture where the inside is no ink: odds of 150 to 1
DEEPER_NOISY = 5.0
# grey of the chamfer between bore (0) and face (1): nearer to either than MIN_CHAMFER it may be a printed line; beyond
# PLAIN_CHAMFER it is none
MIN_CHAMFER, PLAIN_CHAMFER = 0.085, 0.3
CHAMFER_NOISES = 2.0
# share of the face's light: the blackest inks return more than the first, nearly all inks more than the second; the
# second is the bound where there is a chamfer, the third where there plainly is one
BLACK_SHARES = 0.022, 0.034, 0.05
# if the inside is seen above this many noises, a hole would show its depth
FAINT_NOISES = 1.4
# least share of the inside that the face's plane leaves unexplained if the inside does not lie in it
NOT_IN_PLANE = 0.44
CHAMFERED_M = 1e-4
# saturated share of the inside next to the rim; above it only the inside can prove a hole
WHITE_INSIDE = 0.4
# unevenness (`Inside.uneven`) of ink: in an outline of one step; and in any outline if the inside has this brightness,
# as a share of the face, which is more than stray light in a black bore
EVEN_ONE_STEP, EVEN, INK_SHARES = 0.15, 0.1, (0.1, 0.6)


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """inside: the parallax sweep; chamfer: distance of the chamfer's grey from face or bore, the smaller one, share of
    the step; black: median grey inside over the face's; deeper: log likelihood ratio of a chamfer that goes down
    against one drawn on the face; chamfered: whether the drawing has a chamfer. With more smoothing: deep_below_noise,
    the inside plainly does not lie in the face's plane; flat_below_noise, it does."""

    inside: Inside
    chamfer: float
    black: float
    deeper: float
    chamfered: bool
    deep_below_noise: bool = False
    flat_below_noise: bool = False

    @property
    def seen(self) -> float:
        """The structure of the inside over the noise."""
        return self.inside.structure / max(self.inside.noise, 1e-9)


def chamfer_shade(fit: Fit, rim: Rim, step_grey: float) -> Array:
    """(F, 2), by facing of the walls and by picture: grey of the chamfer, 0 as the bore, 1 as the face; NaN where these
    two are alike."""
    steps = fit.steps
    height = steps.face - steps.bore
    least = max(5.0, 0.2 * step_grey)
    shade = np.where(
        np.abs(height) < least, np.nan, (steps.chamfer - steps.bore) / np.where(height == 0.0, 1.0, height)
    )
    rows = []
    for way in range(int(rim.facing.max()) + 1):
        part = shade[:, rim.facing == way].reshape(2, -1)
        rows.append([float(np.nanmedian(one)) if np.isfinite(one).sum() > 2 else np.nan for one in part])
    return np.array(rows)


def evidence_of(
    images: Images, stereo: StereoModel, hole: Rimmed, rim: Rim, fit: Fit, quality: Quality, doubts: Doubts
) -> Evidence:
    """Collect the evidence for a hole or for a picture of one."""
    noise = tuple(float(np.median(fit.variance[side][..., -3:])) for side in range(2))
    pose = fit.state.pose_camera_hole
    sizes = hole.inner_rim_m(), DEPTHS_M, (noise[0], noise[1])
    inside = seen_inside(images, stereo, pose, *sizes)
    black = inside.bright / max(float(np.median(fit.steps.face)), 1.0)
    # walls, background and prints are wide: smoothing removes the noise and keeps them
    deep_below_noise = flat_below_noise = False
    if inside.noisy:
        smoother = seen_inside(images, stereo, pose, *sizes, SMOOTHER_PX)
        deep_below_noise = (
            black < BOTTOM_SHARE
            and smoother.structure > PLAIN_NOISES * smoother.noise
            and bool(smoother.unexplained[0] > SMOOTHER_DEEP * smoother.structure)
        )
    # an inside darker than nearly all ink is no ink, even if some of the rim's step reaches in
    if inside.noise > SMOOTHEST_GREY and _faint(inside) and black > BLACK_SHARES[1]:
        smoothest = seen_inside(images, stereo, pose, *sizes, SMOOTHEST_PX)
        flat_below_noise = smoothest.structure > SMOOTHEST_NOISES * smoothest.noise and bool(
            smoothest.unexplained[0] < NOT_IN_PLANE * smoothest.structure
        )
    shade = chamfer_shade(fit, rim, quality.step_grey)
    known = shade[np.isfinite(shade)]
    chamfer, deeper = 0.0, 0.0
    chamfered = float(np.abs(hole.inner_rim_m()[:, 2]).max()) > CHAMFERED_M
    if chamfered:
        if len(known) >= 2:
            chamfer = float(min(np.sqrt(np.mean(known**2)), np.sqrt(np.mean((known - 1.0) ** 2))))
        if _depth_by(inside, black, quality) is None:
            deeper = deeper_by(images, rim, stereo, fit, doubts)
    return Evidence(inside, chamfer, black, deeper, chamfered, deep_below_noise, flat_below_noise)


def _faint(inside: Inside) -> bool:
    return inside.structure < FAINT_NOISES * inside.noise


def _depth_by(inside: Inside, black: float, quality: Quality) -> float | None:
    """Depth of the inside, m; infinite where no plane explains it; None where it cannot be told."""
    seen = inside.structure / max(inside.noise, 1e-9)
    if seen < SEEN_NOISES or inside.structure < SEEN_SHARE * quality.step_grey:
        return None
    share = inside.unexplained / inside.structure
    best = int(np.nanargmin(share))
    depth = float(inside.depths_m[best])
    gain = share[0] - share[best]
    # the planes are far apart: the last depth of a pocket counts as deep if the next plane explains more than the one
    # before
    deep_enough = depth > DEEP_M or (depth == DEEP_M and bool(share[best + 1] < share[best - 1]))
    if black > BOTTOM_SHARE:
        # as bright as a bottom with the face's surface
        nothing_like_it = share[best] > BRIGHT_NOT_EXPLAINED and inside.uneven > MIRRORED_UNEVEN
        if nothing_like_it or (gain > BETTER and deep_enough):
            return np.inf
        return depth if not deep_enough and (share[best] < EXPLAINED or gain > BETTER) else None
    if seen > PLAIN_NOISES:
        if share[0] > NOT_EXPLAINED:
            return np.inf
        deep = float(np.nanmin(np.where(inside.depths_m >= DEEP_M, share, np.nan)))
        mirrored = inside.uneven < MIRRORED_UNEVEN and share[best] > MIRRORED * share[0]
        # a wall of a dark bore, visible down to some depth, or the background
        if not mirrored and ((gain > WALL_BETTER and depth >= WALL_M) or deep < share[0] - BETTER):
            return np.inf
        shallow = depth <= DEEP_M and share[-1] > share[best] + BETTER
        return depth if shallow and share[best] < EXPLAINED else None
    # faint: a structure that all planes explain alike is noise
    faintly = NOISY_NOT_EXPLAINED if inside.noisy else FAINTLY_NOT_EXPLAINED
    told = (share[0] > faintly and gain > FAINTLY_BETTER) or gain > PLAINLY_BETTER
    behind = gain > FAINTLY_DEEP and depth > DEEP_M and inside.uneven > MIRRORED_UNEVEN
    return np.inf if behind or (told and inside.uneven > FAINTLY_UNEVEN) else None


def judge(evidence: Evidence, quality: Quality) -> None:
    """Return for a hole. Raises FlatPrint, ShallowPocket or NotSeenInside."""
    inside = evidence.inside
    depth = _depth_by(inside, evidence.black, quality)
    # a faint structure may be noise
    faint = _faint(inside)
    plain = not (faint and evidence.flat_below_noise)
    if (depth is None and evidence.deep_below_noise) or (depth is not None and np.isinf(depth) and plain):
        return
    if depth is not None and FLAT_M < depth < np.inf:
        raise ShallowPocket(
            f"what is seen inside the outline lies {depth * 1e3:.1f} mm below the face, want more than "
            f"{DEEP_M * 1e3:g} mm: a pocket, not the hole; is the right part in the fixture?"
        )
    share = inside.unexplained[0] / max(inside.structure, 1e-9)
    if depth is not None and depth < np.inf:
        raise FlatPrint(
            f"what is seen inside the outline lies in the face's plane ({share:.0%} of it left unexplained there): a "
            "print or a sticker, not a hole; is the right part in the fixture?"
        )
    sure = max(MIN_CHAMFER, CHAMFER_NOISES * quality.residual)
    # beside a white inside the chamfer's grey is a guess; and a pocket, as bright as its bottom, has a chamfer as well
    chamfer = evidence.chamfer > sure and quality.inside_saturated < WHITE_INSIDE and evidence.black < BOTTOM_SHARE
    # a chamfer that is as likely drawn on the face proves nothing
    no_ink = evidence.black < BLACK_SHARES[2] or inside.uneven > INK_UNEVEN
    # noise can make a single line look like a chamfer, and changes the likelihood
    noise = max(inside.noise / NOISY_GREY, 1.0) ** 2
    least_of_all = DEEPER_NOISY if inside.noisy else 0.0
    deeper_least = DEEPER_PLAIN if not faint else least_of_all if no_ink else MIN_DEEPER * noise
    not_in_plane = plain and (faint or share > NOT_IN_PLANE)
    if chamfer and evidence.deeper > deeper_least and not_in_plane:
        return
    # ink that is seen at all lies in the face's plane
    plain_chamfer = evidence.chamfer > PLAIN_CHAMFER and evidence.deeper > least_of_all
    least = BLACK_SHARES[0] if not chamfer else BLACK_SHARES[1] if not plain_chamfer else BLACK_SHARES[2]
    if evidence.black < least and not_in_plane:
        return
    one_step = evidence.chamfered and evidence.chamfer <= sure and evidence.black > BLACK_SHARES[0]
    ink = INK_SHARES[0] < evidence.black < INK_SHARES[1]
    if (one_step and inside.uneven < EVEN_ONE_STEP) or (ink and inside.uneven < EVEN):
        # a black hole under stray light and an even dome could look like that: not certain
        step = "the outline is one step, without the drawing's chamfer, and " if one_step else ""
        raise FlatPrint(
            f"{step}the inside is evenly {evidence.black:.0%} as bright as the face: most likely a print or a sticker, "
            "not a hole; is the right part in the fixture? if so, light it from another side",
            certain=False,
        )
    raise NotSeenInside(
        f"the inside (grey {inside.bright:.0f}, {evidence.black:.1%} of the face) does not tell its depth and the "
        f"chamfer, {evidence.chamfer:.0%} of the step from a printed line, want {sure:.0%}, is no proof: hole or "
        "print? light it from another side, or expose longer, so that a wall or the chamfer is seen"
    )
