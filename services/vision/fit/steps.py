"""Two steps across the rim, face to chamfer and chamfer to bore, with every grey free and projected out.

grey(t) = F (1 - Phi1) + C (Phi1 - Phi2) + B Phi2, t along the normal: F and B per profile, C linear along a group,
with the slopes of face and bore (variable projection, Golub and Pereyra 1973, Kaufman's form). Either sign of either
step.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from crosspih_common.geometry.pose import Array
from services.vision.fit.rim import SeenRim

STEP_PX = 0.5
MIN_SPREAD_PX = 0.3
# slope of face and bore beside the rim, sd, share of the step a pixel
FACE_SLOPE_SHARE, BORE_SLOPE_SHARE = 0.01, 0.03
# the chamfer's grey from the middle of a group to its end, sd, share of the step
CHAMFER_CHANGE_SHARE = 0.05
SATURATED_GREY = 250.0
# farther outside the rim than this many sd of the blur, light from inside cannot saturate a dark face
WHITE_FACE_BLURS = 1.2
# sd of the grey of a saturated face or bore
UNSEEN_GREY = 2000.0
# columns of a profile's table
FACE, BORE, CHAMFER, FACE_SLOPE, BORE_SLOPE, GREY, FIRST, SECOND, FIRST_BLUR, SECOND_BLUR = range(10)
SHOWN, GREYS = 5, 6  # number of first columns that make up the grey; with the grey, without the derivatives


def sample(image: NDArray[np.float32], points_px: Array) -> Array:
    """Grey at points (..., 2), px, cubic interpolation; beyond the border the border's grey."""
    # remap wants its maps below 32768 in each direction: a row a profile
    rows = points_px.reshape(-1, points_px.shape[-2], 2).astype(np.float32)
    grey = cv2.remap(image, rows[..., 0], rows[..., 1], interpolation=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(grey, dtype=float).reshape(points_px.shape[:-1])


def nearest_pixels(image: NDArray[np.float32], points_px: Array) -> tuple[NDArray[np.int64], Array]:
    """The pixels next to points (..., 2): their places (..., 2), px, and their grey; beyond the border the border's."""
    height, width = image.shape
    at = np.clip(np.rint(np.nan_to_num(points_px)), 0, (width - 1, height - 1)).astype(np.int64)
    return at, image[at[..., 1], at[..., 0]].astype(float)


@dataclass(frozen=True, slots=True, eq=False)
class Profiles:
    """Pixels next to the normals: their grey (2, G, S, L), their places along the normals, `offsets_px`, px, and
    whether they count, `inside`, 0 or 1 (2, G, S, L each); `beyond` (2, G, S): grey one more chamfer's width into the
    hole.

    The pixels are used as they are, without interpolation: an interpolated edge is shifted and blurred against the
    model, and next to a saturated pixel it is wrong by tens of grey.
    """

    offsets_px: Array
    grey: Array
    inside: Array
    beyond: Array


def profiles(images: tuple[NDArray[np.float32], NDArray[np.float32]], rim: SeenRim, blur_px: float) -> Profiles:
    """Sample across the rim; a wider blur is sampled farther to both sides."""
    face, bore = 2.0 + 2.0 * blur_px, 0.8 + 1.3 * blur_px
    chamfer = np.maximum(rim.chamfer_px, 0.0)
    wanted = np.arange(-np.ceil(2 * face) / 2, float(chamfer.max()) + bore + STEP_PX, STEP_PX)
    along = np.broadcast_to(wanted, (*chamfer.shape, len(wanted)))
    along = np.concatenate([along, (2.0 * chamfer + bore)[..., None]], axis=-1)
    points = rim.outer_px[..., None, :] + along[..., None] * rim.normal[..., None, :]
    at, grey = (np.stack(both) for both in zip(*map(nearest_pixels, images, points), strict=True))
    at, grey, beyond = at[..., :-1, :], grey[..., :-1], grey[..., -1]
    # an edge is straight over half a pixel: only a pixel's place across it counts
    offsets = np.einsum("kgsli,kgsi->kgsl", at - rim.outer_px[..., None, :], rim.normal)
    inside = offsets < chamfer[..., None] + bore
    for side in range(2):
        height, width = images[side].shape
        inside[side] &= np.all((at[side] > 1) & (at[side] < (width - 2, height - 2)), axis=-1)
    # a saturated pixel gives a lower bound of its brightness only
    white = grey > SATURATED_GREY
    # if the place of the face is white, and it is not white farther out, the rim does not lie here
    odd = white & (offsets < -WHITE_FACE_BLURS * blur_px) & ~white[..., :1]
    return Profiles(offsets, grey, (inside & (~white | odd)).astype(float), beyond)


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """The greys fitted at a pose and blur; per profile unless stated otherwise.

    Greys: face, chamfer, bore (2, G, S); model and residual (2, G, S, L).
    table (2, G, S, 6, 6): scalar products of the residual and of the derivatives by the outer step, the inner step,
    their blur variances and the chamfer's grey; weighted, with the profile's own two greys projected out. shared (2, G,
    S, 6, 3): scalar products of the same with the group's shared columns; inverse (2, G, 3, 3) of the latter.
    """

    face: Array
    chamfer: Array
    bore: Array
    model: Array
    residual: Array
    table: Array
    shared: Array
    inverse: Array


def columns_of(seen_profiles: Profiles, rim: SeenRim, variance_px2: Array) -> Array:
    """(2, G, S, 10, L): the components of a profile's grey and their derivatives; `variance_px2` (2, G, S): the blur's
    variance along each normal."""
    offsets, grey = seen_profiles.offsets_px, seen_profiles.grey
    spread = np.sqrt(np.maximum(variance_px2, MIN_SPREAD_PX**2))[..., None]
    chamfer = np.maximum(rim.chamfer_px, 0.0)[..., None]
    from_inner = offsets - chamfer
    bell = 1.0 / (spread * np.sqrt(2.0 * np.pi))
    half = 0.5 / spread**2
    columns = np.empty((*grey.shape[:3], 10, grey.shape[3]))
    second = ndtr(from_inner / spread)
    columns[..., FACE, :] = 1.0 - ndtr(offsets / spread)
    columns[..., BORE, :] = second
    columns[..., GREY, :] = grey
    columns[..., CHAMFER, :] = 1.0 - columns[..., FACE, :] - second
    columns[..., FACE_SLOPE, :] = offsets * columns[..., FACE, :]
    columns[..., BORE_SLOPE, :] = from_inner * second
    columns[..., FIRST, :] = -np.exp(-half * offsets**2) * bell
    columns[..., SECOND, :] = -np.exp(-half * from_inner**2) * bell
    columns[..., FIRST_BLUR, :] = offsets * columns[..., FIRST, :] * half
    columns[..., SECOND_BLUR, :] = from_inner * columns[..., SECOND, :] * half
    return columns


def steps(columns: Array, weight: Array, chamfer_grey: Array | None = None, greys_only: bool = False) -> Steps:
    """The greys that fit best. `weight` (2, G, S, L): the inverse variance of the noise; `chamfer_grey` (2, G): grey in
    the middle of each group, None to fit it. `greys_only`: table and shared stay empty."""
    if greys_only:
        columns = columns[..., :GREYS, :]
    grey = columns[..., GREY, :]
    groups, samples = grey.shape[1], grey.shape[2]
    gram = (columns * weight[..., None, :]) @ np.swapaxes(columns, -1, -2)
    own = gram[..., :2, :2] + UNSEEN_GREY**-2 * np.eye(2)
    across = gram[..., :2, 2:]
    solved = _solve2(own, across)
    left = gram[..., 2:, 2:] - np.swapaxes(across, -1, -2) @ solved
    # shared by the group: the change of the chamfer's grey along it, the slopes of face and bore, and the chamfer's
    # grey
    ramp = np.linspace(-1.0, 1.0, samples)
    kinds = np.array([CHAMFER, FACE_SLOPE, BORE_SLOPE, CHAMFER]) - 2
    scale = np.ones((samples, 4))
    scale[:, 0] = ramp
    between = left[..., kinds] * scale[:, None, :]
    within = (between[..., kinds, :] * scale[:, :, None]).sum(axis=2)
    to_grey = between[..., GREY - 2, :].sum(axis=2)
    height = np.sqrt(np.mean((solved[..., 0, GREY - 2] - solved[..., 1, GREY - 2]) ** 2, axis=-1)) + 1.0
    ridge = np.zeros((2, groups, 4, 4))
    ridge[..., 0, 0] = 1.0 / (CHAMFER_CHANGE_SHARE * height) ** 2
    ridge[..., 1, 1] = 1.0 / (FACE_SLOPE_SHARE * height) ** 2
    ridge[..., 2, 2] = 1.0 / (BORE_SLOPE_SHARE * height) ** 2
    ridge[..., 3, 3] = 1.0 / (5.0 * height) ** 2
    within = within + ridge
    inverse = np.linalg.inv(within[..., :3, :3])
    if chamfer_grey is None:
        made = np.linalg.solve(within, to_grey[..., None])[..., 0]
    else:
        rest = to_grey[..., :3] - within[..., :3, 3] * chamfer_grey[..., None]
        made = np.concatenate([np.einsum("kgij,kgj->kgi", inverse, rest), chamfer_grey[..., None]], axis=-1)
    change, slope_face, slope_bore, middle = (made[..., index, None] for index in range(4))
    grey_chamfer = middle + change * ramp
    taken = solved[..., GREY - 2] - (
        solved[..., CHAMFER - 2] * grey_chamfer[..., None]
        + solved[..., FACE_SLOPE - 2] * slope_face[..., None]
        + solved[..., BORE_SLOPE - 2] * slope_bore[..., None]
    )
    face, bore = taken[..., 0], taken[..., 1]
    amounts = np.empty((*face.shape, SHOWN))
    for index, amount in enumerate((face, bore, grey_chamfer, slope_face, slope_bore)):
        amounts[..., index] = amount
    model = (amounts[..., None, :] @ columns[..., :SHOWN, :])[..., 0, :]
    if greys_only:
        none = np.empty(0)
        return Steps(face, grey_chamfer, bore, model, grey - model, none, none, inverse)
    # residual, and the derivatives by the places of the steps and by the blur: each shape times the height of its step
    first_step, second_step = grey_chamfer - face, bore - grey_chamfer
    wanted = np.array([GREY, FIRST, SECOND, FIRST_BLUR, SECOND_BLUR, CHAMFER]) - 2
    heights = np.ones((*face.shape, len(wanted)))
    for index, step in enumerate((first_step, second_step, first_step, second_step), start=1):
        heights[..., index] = step
    table = left[..., wanted[:, None], wanted] * heights[..., :, None] * heights[..., None, :]
    # the residual is the grey minus the part that the group's greys explain; a profile's own two are already removed
    explained = left[..., wanted[:, None], kinds[1:]] @ amounts[..., [3, 4, 2], None]
    table[..., 0, 1:] -= (explained[..., 0] * heights)[..., 1:]
    table[..., 1:, 0] = table[..., 0, 1:]
    shared = left[..., wanted[:, None], kinds[:3]] * heights[..., :, None] * scale[:, None, :3]
    return Steps(face, grey_chamfer, bore, model, grey - model, table, shared, inverse)


def _solve2(matrix: Array, right: Array) -> Array:
    """Many 2 by 2 systems at once."""
    a, b, c, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 0], matrix[..., 1, 1]
    determinant = a * d - b * c
    top = (d[..., None] * right[..., 0, :] - b[..., None] * right[..., 1, :]) / determinant[..., None]
    bottom = (a[..., None] * right[..., 1, :] - c[..., None] * right[..., 0, :]) / determinant[..., None]
    return np.stack([top, bottom], axis=-2)
