"""Checks that decide whether a fit can be trusted, and the advice given where it cannot."""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.fit.quality import Quality
from services.vision.fit.rim import Rim
from services.vision.hidden import hidden_parts
from services.vision.refusals import (
    CutOff,
    NoCross,
    NotAStereoPair,
    NotEnoughRim,
    NotTheDrawing,
    OutsidePrior,
    PoorFit,
    TooBright,
    TooDark,
)

# least share of the rim inside both pictures; least share that looks like a rim; least share of edges that do
MIN_INSIDE, MIN_SUPPORT, MIN_EDGES = 0.6, 0.5, 0.5
MAX_SATURATED = 0.25
# a rim with saturated parts is only half visible: it is accepted if calibration and drawing are not in conflict with it
MAX_RIM_SATURATED, MAX_SATURATED_OFFSET, MAX_SATURATED_SIZES = 0.5, 4.0, 10.0
# with only the chamfer saturated and the inside visible: clipping of the blur makes the outer line look wider
WHITE_RIM_INSIDE, WHITE_RIM_SIZES = 0.1, 18.0
STEP_NOISES, MIN_STEP_GREY = 4.0, 4.0
# a face darker than this could hide a hole
DARK_GREY = 25.0
# on such a face, a step below this many noises is the cause reported when the rim is not seen well
DIM_NOISES = 8.0
MAX_RESIDUAL = 0.1
# largest roughness at the rim, share of the step; a stricter bound where less than this share looks like a rim
MAX_ROUGH, MAX_ROUGH_COVERED, COVERED = 0.35, 0.16, 0.85
# chi2 of the conflict with the calibration (2 dof) and with the drawing (4 dof)
MAX_OFFSET, MAX_SIZES = 7.0, 25.0
PRIOR_SLACK = 1.3


def require_sound(quality: Quality, rim: Rim) -> None:
    """Raises the VisionRefusal that best describes the fault of a fit."""
    if quality.saturated > MAX_SATURATED:
        raise TooBright(
            f"{quality.saturated:.0%} of the face beside the rim is saturated, want less than {MAX_SATURATED:.0%}: "
            "expose less, or take the glare off it"
        )
    saturated = quality.rim_saturated > MAX_RIM_SATURATED
    blind = quality.inside < MIN_INSIDE
    sizes_most = WHITE_RIM_SIZES if quality.inside_saturated < WHITE_RIM_INSIDE else MAX_SATURATED_SIZES
    odd = quality.offset_conflict > MAX_SATURATED_OFFSET or quality.sizes_conflict > sizes_most
    if saturated and (odd or blind):
        raise TooBright(
            f"{quality.rim_saturated:.0%} of the rim is beside something saturated: expose less, or take the glare "
            "off it"
        )
    if quality.inside < MIN_INSIDE:
        raise CutOff(
            f"{quality.inside:.0%} of the rim lies inside the picture, want {MIN_INSIDE:.0%}: move camera or part"
        )
    step = max(STEP_NOISES * quality.noise_grey, MIN_STEP_GREY)
    dark = quality.face_grey < DARK_GREY
    too_dark = TooDark(
        f"the rim's step is {quality.step_grey:.0f} grey levels in noise of {quality.noise_grey:.1f}, want "
        f"{max(DIM_NOISES * quality.noise_grey, step):.0f} or more: expose longer, or light it more"
    )
    dim = dark and quality.step_grey < DIM_NOISES * quality.noise_grey
    if quality.step_grey < step:
        if not dark:
            raise NoCross(
                f"where the rim should be the step is {quality.step_grey:.0f} grey levels in noise of "
                f"{quality.noise_grey:.1f}, on a face of grey {quality.face_grey:.0f}: no such hole is there; is it "
                "the right part, and the right way round?"
            )
        raise too_dark
    # each picture by itself: a picture with the whole rim does not vouch for one that shows something else
    seen = quality.support.mean(axis=1)
    edges = np.mean(quality.support > 0.5, axis=1)
    if seen.min() < MIN_SUPPORT or edges.min() < MIN_EDGES:
        if dim:
            raise too_dark
        side = int(np.argmin(np.minimum(seen, edges)))
        raise NotEnoughRim(
            f"{seen[side]:.0%} of the rim and {edges[side]:.0%} of its edges can be seen in the "
            f"{('left', 'right')[side]} picture, want {MIN_SUPPORT:.0%}; hidden or dark is "
            f"{hidden_parts(quality.support, rim)}: take away what covers it, or light the dark side"
        )
    rough_most = MAX_ROUGH if quality.supported > COVERED else MAX_ROUGH_COVERED
    # a residual of the size of the noise is no objection, however low the step
    noise = quality.noise_grey / max(quality.step_grey, 1.0)
    unexplained = float(np.sqrt(max(quality.residual**2 - noise**2, 0.0)))
    if unexplained > MAX_RESIDUAL or quality.rough > rough_most:
        if dim:
            raise too_dark
        raise PoorFit(
            f"at the rim {unexplained:.0%} of the step is left unexplained, want less than "
            f"{MAX_RESIDUAL:.0%}, and its texture is {quality.rough:.0%} of it, want less than {rough_most:.0%}: use "
            "a larger, softer light"
        )
    # an outline of another size conflicts with the calibration as well, and more strongly with the drawing
    drawing_first = quality.sizes_conflict > quality.offset_conflict
    if quality.offset_conflict > MAX_OFFSET and not drawing_first:
        du, dv = quality.offset_px
        raise NotAStereoPair(
            f"the right picture is off by ({du:.2f}, {dv:.2f}) px or more ({quality.offset_conflict:.0f}, want "
            f"less than {MAX_OFFSET:g}): was a camera moved, do the pictures belong together, does the light glare "
            "in one?"
        )
    if quality.sizes_conflict > MAX_SIZES or quality.offset_conflict > MAX_OFFSET:
        outer, inner, near, far = quality.sizes_m * 1e3
        raise NotTheDrawing(
            f"the outline is not the drawing's: outer line {outer:+.2f} mm, inner {inner:+.2f}, near edges "
            f"{near:+.2f}, far {far:+.2f} ({quality.sizes_conflict:.0f}, want less than {MAX_SIZES:g}; the pictures "
            f"apart by {quality.offset_conflict:.0f}, want {MAX_OFFSET:g}): is it the right part and cell, is "
            "cell.hole.tolerance too small?"
        )


def require_drawn_edges(elsewhere: list[tuple[int, float]]) -> None:
    """Raises NotTheDrawing where edges of the rim (their number, and their offset outward, m) lie elsewhere."""
    if elsewhere:
        group, offset = max(elsewhere, key=lambda one: abs(one[1]))
        raise NotTheDrawing(
            f"{len(elsewhere)} edges of the rim are not where the drawing has them, edge {group} by "
            f"{offset * 1e3:+.1f} mm, in the face's plane: is it the right part and cell?"
        )


def require_inside_prior(nominal: Pose, half_ranges: Array, pose_base_hole: Pose) -> None:
    """Raises OutsidePrior if the pose differs from `nominal` by more than `half_ranges` (6,), m and rad, and some
    slack."""
    off = nominal.inverse() @ pose_base_hole
    error = np.concatenate([off.translation_m, off.rotvec_rad()])
    worst = int(np.argmax(np.abs(error) / half_ranges))
    if abs(error[worst]) > PRIOR_SLACK * half_ranges[worst]:
        name = ("x", "y", "z", "rx", "ry", "rz")[worst]
        unit, factor = ("mm", 1e3) if worst < 3 else ("rad", 1.0)
        raise OutsidePrior(
            f"{name} is {error[worst] * factor:.3g} {unit} from the nominal hole, want within "
            f"{half_ranges[worst] * PRIOR_SLACK * factor:.3g}"
        )
