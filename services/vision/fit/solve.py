"""Pose, blur and deviations from the drawing, from both pictures: Gauss-Newton with random effects.

Every edge may be off by a little in each picture, and all edges that face one way may be off together: chamfers are not
evenly grey, walls are lit, edges are broken. The size of these effects is measured from how well the edges agree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.vision.fit.blur import BLUR_ALIKE, BLUR_ALIKE_SD_PX2, BLUR_ROUND, blur_belief, roundness
from services.vision.fit.medians import median
from services.vision.fit.noise import robust_weight, variance_by_grey
from services.vision.fit.rim import Rim, SeenRim, perturbed, seen
from services.vision.fit.shading import shade_belief
from services.vision.fit.steps import STEP_PX, Profiles, Steps, columns_of, profiles, steps
from services.vision.stereo import StereoModel

Images = tuple[NDArray[np.float32], NDArray[np.float32]]

POSE, OUTER, INNER, NEAR, FAR = 6, 6, 7, 8, 9
EDGE, TURN = 15, 16  # indices of local parameters: an edge's shift in one picture, px, and the shift of its ends
SIZES = 4  # outer line, inner line, near edges, far edges
COMMON = POSE + SIZES
LOCAL = 21
# a shift in one picture occurs twice: for the edge itself, and for all edges that face its way
TWICE = [*range(LOCAL), 15]
BLUR_START_PX2 = 0.8
HELD = 1e9
MIN_BLUR_PX2, MAX_BLUR_PX2 = 0.1, 9.0
MAX_BLUR_FACTOR = 4.0  # largest factor on the blur in one step
EFFECT_DEGREES = 4.0
ROUGH_GREY = 3.0  # before the noise is measured
SHINE_FREE = 1.5  # a chamfer up to this many times as bright as the face is lit, and does not shine
SHADE_MEAN, SHADE_SD = 0.5, 1.0
MAX_LEVEL, CHAMFER_STEP = 1.5, 1.0  # times the median height of a step; a change in one step, times that level
CHAMFER_SHARES = (-0.3, 6.0)  # limits of a chamfer's grey, times the face's
# random effects beside the common ones: sd before it is measured, and the number of effects that weigh as much as this
# prior. wall: both lines of an edge, m. rim: the outer line of all edges that face one way, m (a broken edge shines or
# not by its facing); lip: the inner line. facing, edge, turn, px in one picture: all edges that face one way; one edge;
# its ends. chamfer: a chamfer's grey over the face's, beside the common one of its facing
EFFECTS: dict[str, tuple[float, float]] = {
    "wall": (0.02e-3, 4.0),
    "rim": (0.03e-3, 4.0),
    "lip": (0.03e-3, 4.0),
    "facing": (0.015, 4.0),
    "edge": (0.02, 8.0),
    "turn": (0.015, 8.0),
    "chamfer": (0.05, 8.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class Doubts:
    """The uncertainty of the drawing, one sd, m: the outer and the inner line by broken edges, all lines by tolerance;
    of the calibration, px: the right picture against the left one; and of each lens's k1, if the calibration states its
    distortion and if it states none."""

    outer_sd_m: float = 0.06e-3
    inner_sd_m: float = 0.06e-3
    size_sd_m: float = 0.03e-3
    offset_sd_px: float = 0.03
    k1_sd: float = 0.001
    k1_untold_sd: float = 0.03

    def sds(self) -> Array:
        """(4,): outer line, inner line, near edges, far edges."""
        return np.array([self.outer_sd_m, self.inner_sd_m, self.size_sd_m, self.size_sd_m])


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The state of the fit: the pose, sizes (4,) m (outer, inner, near, far), blur (2, 3) px^2 (uu, uv, vv), and the
    variance of each kind of effect, m^2, px^2 or 1. gloss: the face's difference between the cameras; chamfer_grey (2,
    G) and profile_weight (2, G, S): None before the first look."""

    pose_camera_hole: Pose
    sizes_m: Array
    blur_px2: Array
    effects: dict[str, Array]
    gloss: float = 0.0
    chamfer_grey: Array | None = None
    profile_weight: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The result: the state, posterior covariance (P, P) with the pose first, effects (P,), information on the pose
    from each edge, and the output of the last look at the pictures."""

    state: State
    covariance: Array
    effects: Array
    seen: SeenRim
    profiles: Profiles
    steps: Steps
    variance: Array
    even: Array
    weight: Array
    local: Array
    gradient: Array


GLOSS_SD = {"wall": 0.2e-3, "rim": 0.3e-3, "lip": 0.3e-3, "facing": 0.6, "edge": 0.2, "turn": 0.1, "chamfer": 0.5}
MAX_GLOSS = 0.3


def believed(kind: str, gloss: float) -> float:
    """The prior sd of a random effect; it grows with the gloss, because a shine differs between the cameras."""
    return float(np.hypot(EFFECTS[kind][0], GLOSS_SD[kind] * min(gloss, MAX_GLOSS)))


def start_state(rim: Rim, pose: Pose, blur_px2: float = BLUR_START_PX2) -> State:
    """A fit's beginning at a pose."""
    kinds = parameters(rim)[2]
    return State(
        pose,
        np.zeros(SIZES),
        np.tile([blur_px2, 0.0, blur_px2], (2, 1)).astype(float),
        {kind: np.full(kinds[kind].stop - kinds[kind].start, sd**2) for kind, (sd, _) in EFFECTS.items()},
    )


def grown(rim: Rim, sizes: Array) -> Rim:
    """The rim with its lines moved outward by sizes (4,), m: outer line, inner line, near edges, far edges."""
    both = (sizes[2] + (sizes[3] - sizes[2]) * rim.reach)[:, None, None] * rim.outward
    return replace(
        rim, outer_m=rim.outer_m + both + sizes[0] * rim.outward, inner_m=rim.inner_m + both + sizes[1] * rim.outward
    )


def _taken(
    images: Images, rim: Rim, stereo: StereoModel, state: State, extra_px2: float
) -> tuple[SeenRim, Array, Array, Profiles]:
    moved = seen(grown(rim, state.sizes_m), stereo, state.pose_camera_hole)
    n = moved.normal
    square = np.stack([n[..., 0] ** 2, 2.0 * n[..., 0] * n[..., 1], n[..., 1] ** 2], axis=-1)
    variance_px2 = np.einsum("kgsi,ki->kgs", square, state.blur_px2) + extra_px2
    blur = float(np.sqrt(np.clip(median(variance_px2), 0.25, 6.0)))
    taken = profiles(images, moved, blur)
    return moved, square, variance_px2, taken


def _maps(rim: Rim, moved: SeenRim, square: Array) -> Array:
    """(2, G, S, 5, 21): derivatives of outer step, inner step, their blurs and chamfer grey by local parameters: pose
    6, sizes 4, blur 3, wall, rim, edge, turn, chamfer grey, the right picture's offset (u, v), lip."""
    groups, samples = rim.shape
    maps = np.zeros((2, groups, samples, 5, LOCAL))
    maps[..., 0, :6], maps[..., 1, :6] = moved.outer_slope, moved.inner_slope
    out = moved.outward_slope
    maps[..., 0, OUTER], maps[..., 1, INNER] = out, out
    maps[..., 0, 14] = out
    maps[..., 4, 17] = 1.0
    maps[..., 1, 20] = out
    for step in range(2):
        maps[1, ..., step, 18:20] = moved.normal[1]
    for step in range(2):
        maps[..., step, NEAR] = out * (1.0 - rim.reach)[:, None]
        maps[..., step, FAR] = out * rim.reach[:, None]
        maps[..., step, 13] = out
        maps[..., step, 15] = 1.0
        maps[..., step, 16] = np.linspace(-1.0, 1.0, samples)
        maps[..., 2 + step, 10:13] = square
    return maps


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """The measurements of the pictures at a state, as a fit and a step need them: chamfer_grey (2, G), height (2, G, S)
    of the step, and the products of the normals' components (2, G, S, 3)."""

    state: State
    seen: SeenRim
    profiles: Profiles
    steps: Steps
    variance: Array
    even: Array
    weight: Array
    chamfer_grey: Array
    profile_weight: Array
    height: Array
    square: Array


def look(images: Images, rim: Rim, stereo: StereoModel, state: State, extra_px2: float = 0.0) -> Look:
    """The first half of a step: enough for the state's likelihood. `extra_px2`: blur added to the pictures."""
    moved, square, variance_px2, taken = _taken(images, rim, stereo, state, extra_px2)
    columns = columns_of(taken, moved, variance_px2)
    known = state.profile_weight if state.profile_weight is not None else np.ones(taken.grey.shape[:3])
    first = steps(columns, taken.inside * known[..., None] / ROUGH_GREY**2, state.chamfer_grey, greys_only=True)
    variance = variance_by_grey(first.model, first.residual, taken.inside, state.profile_weight)
    height = np.maximum(np.abs(first.chamfer - first.face), np.abs(first.bore - first.face))
    face = np.maximum(first.face.mean(axis=2), 1.0)
    glint = np.clip(first.chamfer.mean(axis=2) / face - SHINE_FREE, 0.0, 1.0)
    weight, profile_weight, even = robust_weight(first.model, first.residual, variance, height, taken.inside, glint)
    chamfer = state.chamfer_grey
    if chamfer is None:
        chamfer = np.asarray(first.chamfer.mean(axis=2))
    # the number of independent pixels that a sample stands for
    share = np.minimum(moved.spacing_px, 1.0) * STEP_PX
    now = steps(columns, weight * share[..., None], chamfer)
    return Look(state, moved, taken, now, variance, even, weight, chamfer, profile_weight, height, square)


def stepped(
    rim: Rim, looked: Look, doubts: Doubts, hold_blur: bool = False, hold_pose: bool = False
) -> tuple[State, Fit]:
    """The second half: one Gauss-Newton step from a look. `hold_blur`, `hold_pose`: keep that part unchanged."""
    state, now, chamfer = looked.state, looked.steps, looked.chamfer_grey
    maps = _maps(rim, looked.seen, looked.square)
    table = now.table[..., 1:, 1:]
    # all edges at once: by local parameters, by what their profiles share, and the pull
    beside = np.concatenate([table @ maps, now.shared[..., 1:, :], now.table[..., 0, 1:, None]], axis=-1)
    rows = 2, rim.shape[0], -1
    summed = np.swapaxes(maps.reshape(*rows, LOCAL), -1, -2) @ beside.reshape(*rows, beside.shape[-1])
    to_four, pull = summed[..., LOCAL:-1], summed[..., -1]
    local = summed[..., :LOCAL] - to_four @ now.inverse @ np.swapaxes(to_four, -1, -2)
    # the grey of a saturated chamfer is unknown: its own height must not serve as its reference
    rise = looked.height.mean(axis=2)
    level = np.maximum(now.face.mean(axis=2), np.minimum(rise, MAX_LEVEL * median(rise))) + 1.0
    covariance, effects = _solve(rim, state, doubts, local, pull, chamfer / level, level, hold_blur, hold_pose)
    fit = Fit(
        state, covariance, effects, looked.seen, looked.profiles, now, looked.variance, looked.even, looked.weight,
        local, pull,
    )  # fmt: skip
    after = replace(state, profile_weight=looked.profile_weight)
    return _moved(rim, after, chamfer, covariance, effects, level), fit


def iterate(
    images: Images, rim: Rim, stereo: StereoModel, state: State, doubts: Doubts, extra_px2: float = 0.0,
    hold_blur: bool = False,
) -> tuple[State, Fit]:  # fmt: skip
    """A look and a step."""
    return stepped(rim, look(images, rim, stereo, state, extra_px2), doubts, hold_blur)


def parameters(rim: Rim) -> tuple[NDArray[np.int64], int, dict[str, slice]]:
    """(2, G, 22): index of each edge's local parameters among all parameters, in the order of TWICE; the number of all
    parameters; and the slice of each kind of effect in the covariance and in the effects."""
    return _indices_of(rim.shape[0], tuple(rim.facing.tolist()))


@lru_cache(maxsize=32)
def _indices_of(groups: int, facing: tuple[int, ...]) -> tuple[NDArray[np.int64], int, dict[str, slice]]:
    facings = max(facing) + 1
    ways = np.array(facing)
    counts = {
        "wall": groups,
        "rim": facings,
        "lip": facings,
        "facing": 2 * facings,
        "edge": 2 * groups,
        "turn": 2 * groups,
        "chamfer": 2 * groups,
        "shade": facings,
        "offset": 2,
    }
    kinds, total = {}, COMMON + 6
    for kind, count in counts.items():
        kinds[kind] = slice(total, total + count)
        total += count
    index = np.zeros((2, groups, LOCAL + 1), dtype=int)
    each = np.arange(groups)
    for side in range(2):
        index[side, :, :COMMON] = np.arange(COMMON)
        index[side, :, COMMON : COMMON + 3] = COMMON + 3 * side + np.arange(3)
        index[side, :, 13] = kinds["wall"].start + each
        index[side, :, 14] = kinds["rim"].start + ways
        index[side, :, 15] = kinds["edge"].start + side * groups + each
        index[side, :, 16] = kinds["turn"].start + side * groups + each
        index[side, :, 17] = kinds["chamfer"].start + side * groups + each
        index[side, :, 18:20] = kinds["offset"].start + np.arange(2)
        index[side, :, 20] = kinds["lip"].start + ways
        index[side, :, LOCAL] = kinds["facing"].start + side * facings + ways
    return index, total, kinds


@lru_cache(maxsize=32)
def _cells_of(groups: int, facing: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The cell of each pair of local parameters in a square of all parameters, and a mask of those above its
    diagonal."""
    index, total, _ = _indices_of(groups, facing)
    return (index[..., :, None] * total + index[..., None, :]).ravel(), np.triu(np.ones((total, total), dtype=bool), 1)


def in_whole(rim: Rim, local: Array) -> Array:
    """(P,): the sum over the edges of both pictures of their local vectors (2, G, 21), by all parameters."""
    index, total, _ = parameters(rim)
    return np.asarray(np.bincount(index.ravel(), local[..., TWICE].ravel(), total), dtype=float)


def _solve(
    rim: Rim, state: State, doubts: Doubts, local: Array, pull: Array, shade: Array, level: Array, hold_blur: bool,
    hold_pose: bool,
) -> tuple[Array, Array]:  # fmt: skip
    index, total, kinds = parameters(rim)
    cells, above = _cells_of(rim.shape[0], tuple(rim.facing.tolist()))
    wide, wide_pull = local[..., TWICE, :][..., TWICE], pull[..., TWICE]
    information = np.asarray(np.bincount(cells, wide.ravel(), total * total), dtype=float).reshape(total, total)
    gradient = np.asarray(np.bincount(index.ravel(), wide_pull.ravel(), total), dtype=float)
    prior = np.zeros(total)
    prior[:POSE] = (HELD if hold_pose else 1e-6) * np.maximum(np.diag(information)[:POSE], 1.0)
    sizes = 1.0 / doubts.sds() ** 2
    prior[POSE:COMMON] = sizes
    gradient[POSE:COMMON] -= sizes * state.sizes_m
    if hold_blur:
        prior[COMMON : COMMON + 6] = HELD
    else:
        blur, off = blur_belief(state.blur_px2)
        prior[COMMON : COMMON + 6] = blur
        gradient[COMMON : COMMON + 6] -= blur * off
        # prior: the lens's blur is nearly round, and alike in both pictures
        flat = state.blur_px2.ravel()
        off, scale = roundness(state.blur_px2)
        sds = [*np.sqrt(0.5 * (scale**2 + off**2)), *[BLUR_ALIKE_SD_PX2] * len(BLUR_ALIKE)]
        for (one, other), sd in zip(BLUR_ROUND + BLUR_ALIKE, sds, strict=True):
            known, apart = 1.0 / sd**2, flat[one] - flat[other]
            for way, at, to in ((1.0, COMMON + one, COMMON + other), (-1.0, COMMON + other, COMMON + one)):
                information[at, at] += known
                information[at, to] -= known
                gradient[at] -= way * known * apart
    for kind, variances in state.effects.items():
        if kind != "chamfer":
            prior[kinds[kind]] = 1.0 / variances
    # a chamfer's grey is a level shared by all that face its way, plus a small effect of its own
    prior[kinds["shade"]] = SHADE_SD**-2
    gradient[kinds["shade"]] += SHADE_SD**-2 * SHADE_MEAN
    information[kinds["shade"], kinds["shade"]] += shade_belief(rim)
    prior[kinds["offset"]] = 1.0 / doubts.offset_sd_px**2
    own = 1.0 / state.effects["chamfer"]
    own_at = np.arange(kinds["chamfer"].start, kinds["chamfer"].stop)
    all_at = kinds["shade"].start + np.tile(rim.facing, 2)
    to_own, to_all = own / level.ravel(), own
    information[own_at, own_at] += to_own / level.ravel()
    np.add.at(information, (all_at, all_at), to_all)
    information[own_at, all_at] -= to_own
    information[all_at, own_at] -= to_own
    gradient[own_at] -= to_own * shade.ravel()
    np.add.at(gradient, all_at, to_all * shade.ravel())
    information[np.diag_indices(total)] += prior
    scale = 1.0 / np.sqrt(np.diag(information))
    factor, failed = dpotrf(information * scale[:, None] * scale, lower=True)
    if failed:
        raise np.linalg.LinAlgError("the rim's equations have no solution")
    inverse, _ = dpotri(factor, lower=True)
    np.copyto(inverse, inverse.T.copy(), where=above)
    covariance = inverse * scale[:, None] * scale
    return covariance, covariance @ gradient


def _moved(rim: Rim, state: State, chamfer_grey: Array, covariance: Array, effects: Array, level: Array) -> State:
    _, _, kinds = parameters(rim)
    step = effects[:POSE].copy()
    # far from the rim the profile is flat, and an unbounded step has no meaning
    step *= min(1.0, 0.002 / max(float(np.linalg.norm(step[:3])), 1e-12))
    blur = state.blur_px2 + effects[COMMON : COMMON + 6].reshape(2, 3)
    before = state.blur_px2[:, [0, 2]]
    blur[:, [0, 2]] = np.clip(
        blur[:, [0, 2]],
        np.maximum(before / MAX_BLUR_FACTOR, MIN_BLUR_PX2),
        np.minimum(before * MAX_BLUR_FACTOR, MAX_BLUR_PX2),
    )
    most = 0.8 * np.sqrt(blur[:, 0] * blur[:, 2])
    blur[:, 1] = np.clip(blur[:, 1], -most, most)
    second = effects**2 + np.diag(covariance)
    change = effects[kinds["chamfer"]].reshape(level.shape)
    chamfer = chamfer_grey + np.clip(change, -CHAMFER_STEP * level, CHAMFER_STEP * level)
    chamfer = np.clip(chamfer, CHAMFER_SHARES[0] * level, CHAMFER_SHARES[1] * level)
    # the chamfer's difference from the others that face its way
    shade = effects[kinds["shade"]][np.tile(rim.facing, 2)]
    spread = np.diag(covariance)[kinds["chamfer"]] / level.ravel() ** 2
    second[kinds["chamfer"]] = (chamfer.ravel() / level.ravel() - shade) ** 2 + spread

    measured = {}
    for kind, (_, belief) in EFFECTS.items():
        sd = believed(kind, state.gloss)
        values = second[kinds[kind]]
        usual = state.effects[kind]
        now = max(float(np.partition(usual, len(usual) // 2)[len(usual) // 2]), sd**2)
        heavy = (EFFECT_DEGREES + 1.0) / (EFFECT_DEGREES + values / now)
        common = (belief * sd**2 + float(np.sum(heavy * values))) / (belief + values.size)
        measured[kind] = (EFFECT_DEGREES * common + values) / (EFFECT_DEGREES + 1.0)
    return State(
        perturbed(state.pose_camera_hole, step),
        state.sizes_m + effects[POSE:COMMON],
        blur,
        measured,
        state.gloss,
        chamfer,
        state.profile_weight,
    )
