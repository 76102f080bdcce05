"""Whether what was fitted is a hole: three witnesses, in the order of what they are worth.

1. What is seen inside does not lie in the face's plane, nor a little below it (parallax).
2. The rim has a chamfer: two steps whose middle grey is neither the face's nor the bore's.
3. The inside is blacker than ink: light that goes in does not come out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.geometry.pose import Array
from services.vision.evidence.inside import Inside, seen_inside
from services.vision.fit.quality import Quality
from services.vision.fit.rim import Rim, Rimmed
from services.vision.fit.solve import Fit, Images
from services.vision.refusals import FlatPrint, NotSeenInside, ShallowPocket
from services.vision.stereo import StereoModel

DEPTHS_M = np.array([0.0, 0.0005, 0.001, 0.0015, 0.002, 0.003, 0.004, 0.006, 0.008, 0.012, 0.018, 0.03])
# what is seen inside is more than noise from there on, times the noise and share of the step
SEEN_NOISES, SEEN_SHARE = 1.1, 0.008
# a plane at some depth explains the inside when it leaves less, and the deepest plane more than that beyond it
EXPLAINED, WORSE_DEEP = 0.6, 0.12
# in the face's plane; in a pocket
FLAT_M, SHALLOW_M = 0.0008, 0.010
# the chamfer's grey between bore (0) and face (1): nearer to either than that it may be a printed line
CHAMFER_LEAST = 0.085
CHAMFER_NOISES = 2.0
# of the face's light: the blackest inks give back more
BLACK_SHARE = 0.027


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """inside: the parallax sweep; chamfer: how far the chamfer's grey is from face and from bore, share of the step,
    the less of both; black: the inside's grey over the face's."""

    inside: Inside
    chamfer: float
    black: float

    @property
    def seen(self) -> float:
        """What is seen inside, times the noise."""
        return self.inside.structure / max(self.inside.noise, 1e-9)

    @property
    def plane_m(self) -> float:
        """The depth of the plane that explains the inside best."""
        return float(self.inside.depths_m[int(np.nanargmin(self.inside.unexplained))])


def chamfer_shade(fit: Fit, rim: Rim, step_grey: float) -> Array:
    """(F, 2): by the way that the walls face, and picture, the chamfer's grey: 0 as the bore, 1 as the face; NaN where
    these are alike."""
    steps = fit.steps
    height = steps.face - steps.bore
    least = max(5.0, 0.2 * step_grey)
    shade = np.where(np.abs(height) < least, np.nan, (steps.chamfer - steps.bore) / np.where(height == 0.0, 1.0, height))
    rows = []
    for way in range(int(rim.facing.max()) + 1):
        part = shade[:, rim.facing == way].reshape(2, -1)
        rows.append([float(np.nanmedian(one)) if np.isfinite(one).sum() > 2 else np.nan for one in part])
    return np.array(rows)


def evidence_of(images: Images, stereo: StereoModel, hole: Rimmed, rim: Rim, fit: Fit, quality: Quality) -> Evidence:
    """All that tells a hole from a picture of one."""
    noise = tuple(float(np.median(fit.variance[side][..., -3:])) for side in range(2))
    pose = fit.state.pose_camera_hole
    inside = seen_inside(images, stereo, pose, hole.inner_rim_m(), DEPTHS_M, (noise[0], noise[1]))
    shade = chamfer_shade(fit, rim, quality.step_grey)
    known = shade[np.isfinite(shade)]
    has_chamfer = float(np.abs(hole.inner_rim_m()[:, 2]).max()) > 1e-4
    chamfer = 0.0
    if has_chamfer and len(known) >= 2:
        chamfer = float(min(np.sqrt(np.mean(known**2)), np.sqrt(np.mean((known - 1.0) ** 2))))
    face = float(np.median(fit.steps.face))
    return Evidence(inside, chamfer, float(np.median(fit.steps.bore)) / max(face, 1.0))


def judge(evidence: Evidence, quality: Quality) -> None:
    """Nothing when it is a hole. Raises FlatPrint, ShallowPocket, NotSeenInside."""
    inside = evidence.inside
    seen = evidence.seen > SEEN_NOISES and inside.structure > SEEN_SHARE * quality.step_grey
    if seen:
        share = inside.unexplained / inside.structure
        best, deepest = float(np.nanmin(share)), float(share[np.isfinite(share)][-1])
        plane = evidence.plane_m
        if best < EXPLAINED and deepest > best + WORSE_DEEP and plane < SHALLOW_M:
            if plane <= FLAT_M:
                raise FlatPrint(
                    f"what is seen inside the outline lies in the face's plane ({best:.0%} of it left unexplained there, "
                    f"{deepest:.0%} by a deep one): a print or a sticker, not a hole; is the right part in the fixture?"
                )
            raise ShallowPocket(
                f"what is seen inside the outline lies {plane * 1e3:.1f} mm below the face, want more than "
                f"{SHALLOW_M * 1e3:g} mm: a pocket, not the hole; is the right part in the fixture?"
            )
        return
    sure = max(CHAMFER_LEAST, CHAMFER_NOISES * quality.residual)
    if evidence.chamfer > sure or evidence.black < BLACK_SHARE:
        return
    raise NotSeenInside(
        f"the inside is evenly dark (grey {inside.bright:.0f}, {evidence.black:.1%} of the face) and no chamfer is seen "
        f"(it differs by {evidence.chamfer:.0%} of the step from a printed line, want {sure:.0%}): hole or print? light "
        "it from another side, or expose longer, so that a wall or the chamfer is seen"
    )
