"""What a plain recipe gives on the same pictures: threshold, contour, corners, solvePnP, and both cameras agreeing.

No knowledge of light or chamfer: the grey's border is taken for the middle of the chamfer.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole

FINER = 4
MAX_RMS_PX = 1.5
"""Of both pictures' corners together: the two cameras must agree."""


def plain_pose(
    pictures: tuple[NDArray[Any], NDArray[Any]], calibration: dict[str, Any], hole: Hole, nominal_base_hole: Pose
) -> Pose | None:
    """`pose_base_hole` by the corners that both pictures show; None where one has none or they do not agree."""
    model = 0.5 * (hole.inner_rim_m() + hole.outer_rim_m())
    pose_base_camera, pose_left_right = (_pose(calibration[name]) for name in ("pose_base_camera", "pose_left_right"))
    nominal = pose_base_camera.inverse() @ nominal_base_hole
    into = (Pose.identity(), pose_left_right.inverse())
    lenses = [_lens(calibration[side]) for side in ("left", "right")]
    seen = []
    for picture, to_camera, lens in zip(pictures, into, lenses, strict=True):
        corners = _corners(_eight_bits(picture), _projected(to_camera @ nominal, model, lens), len(model))
        if corners is None:
            return None
        seen.append(corners)
    ok, turn, shift = cv2.solvePnP(
        model, seen[0], *lenses[0], flags=cv2.SOLVEPNP_IPPE if len(model) > 3 else cv2.SOLVEPNP_SQPNP
    )
    if not ok:
        return None

    def off(vector: Array) -> Array:
        pose = Pose.from_rotvec(vector[:3], vector[3:])
        return np.concatenate(
            [
                (_projected(camera @ pose, model, lens) - at).ravel()
                for camera, lens, at in zip(into, lenses, seen, strict=True)
            ]
        )

    found = least_squares(off, np.concatenate([turn.ravel(), shift.ravel()]), method="lm", x_scale="jac")
    if np.sqrt(np.mean(found.fun**2)) > MAX_RMS_PX:
        return None
    return pose_base_camera @ Pose.from_rotvec(found.x[:3], found.x[3:])


def _pose(said: dict[str, Any]) -> Pose:
    return Pose.from_quaternion(said["quaternion_xyzw"], said["position_m"])


def _lens(said: dict[str, Any]) -> tuple[Array, Array]:
    matrix = np.array([[said["fx_px"], 0.0, said["cx_px"]], [0.0, said["fy_px"], said["cy_px"]], [0.0, 0.0, 1.0]])
    bends = np.zeros(8)
    if said["distortion_model"] == "plumb_bob":
        bends[: len(said["distortion"])] = said["distortion"]
    return matrix, bends


def _projected(pose: Pose, model: Array, lens: tuple[Array, Array]) -> Array:
    pixels, _ = cv2.projectPoints(model, pose.rotvec_rad(), pose.translation_m, *lens)
    return np.asarray(pixels, dtype=float).reshape(-1, 2)


def _eight_bits(picture: NDArray[Any]) -> NDArray[np.uint8]:
    return np.asarray(picture >> 8 if picture.dtype == np.uint16 else picture, dtype=np.uint8)


def _corners(picture: NDArray[np.uint8], expected: Array, count: int) -> Array | None:
    """(count, 2): the corners of the contour that is most like the expected one, in its order; None where none is."""
    area = float(cv2.contourArea(expected.astype(np.float32)))
    size = np.ptp(expected, axis=0).max()
    low = np.maximum(np.floor(expected.min(axis=0) - 0.5 * size), 0).astype(int)
    high = np.minimum(np.ceil(expected.max(axis=0) + 0.5 * size), picture.shape[::-1]).astype(int)
    part = np.asarray(cv2.GaussianBlur(picture[low[1] : high[1], low[0] : high[0]], (0, 0), 0.8), dtype=np.uint8)
    if min(part.shape) < 8:
        return None
    best: tuple[float, Array] | None = None
    for polygon in _polygons(part, area, count):
        corners = polygon + low
        centred, wanted = corners - corners.mean(axis=0), expected - expected.mean(axis=0)
        for ring in (centred, centred[::-1]):
            for turn in range(count):
                far = float(np.mean(np.linalg.norm(np.roll(ring, turn, axis=0) - wanted, axis=1)))
                if best is None or far < best[0]:
                    best = far, np.roll(ring, turn, axis=0) + corners.mean(axis=0)
    return None if best is None or best[0] > 0.2 * size else best[1]


def _polygons(part: NDArray[np.uint8], area: float, count: int) -> Iterator[Array]:
    """Contours (count, 2) of about the area, dark on bright or bright on dark; each edge a line through its points."""
    fine = cv2.resize(part, None, fx=FINER, fy=FINER, interpolation=cv2.INTER_CUBIC)
    level, _ = cv2.threshold(fine, 0, 255, cv2.THRESH_OTSU)
    for bright in (False, True):
        mask = np.asarray((fine > level) == bright, dtype=np.uint8)
        contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for contour in contours:
            if not 0.6 * area < cv2.contourArea(contour) / FINER**2 < 1.6 * area:
                continue
            for share in (0.01, 0.015, 0.02, 0.03):
                polygon = cv2.approxPolyDP(contour, share * cv2.arcLength(contour, True), True)
                if len(polygon) == count:
                    corners = _crossings(contour.reshape(-1, 2), polygon.reshape(-1, 2))
                    yield (corners + 0.5) / FINER - 0.5
                    break


def _crossings(points: NDArray[Any], corners: NDArray[Any]) -> Array:
    """(n, 2): where the lines through a contour's edges cross; `corners` are some of its points, in order."""
    at = [int(np.argmin(np.sum((points - corner) ** 2, axis=1))) for corner in corners]
    lines = []
    for start, end in zip(at, at[1:] + at[:1], strict=True):
        run = np.arange(start, end if end > start else end + len(points)) % len(points)
        kept = points[run[len(run) // 6 : len(run) - len(run) // 6]]
        if len(kept) < 3:
            kept = points[[start, end]]
        middle = kept.mean(axis=0)
        way = np.linalg.svd(kept - middle)[2][0]
        lines.append((middle, way))
    crossings = []
    for (a, u), (b, v), corner in zip(lines[-1:] + lines[:-1], lines, corners, strict=True):
        across = u[0] * v[1] - u[1] * v[0]
        share = ((b - a)[0] * v[1] - (b - a)[1] * v[0]) / across if abs(across) > 0.1 else np.inf
        crossing = a + share * u if np.isfinite(share) else corner
        crossings.append(crossing if np.linalg.norm(crossing - corner) < 3.0 * FINER else corner)
    return np.array(crossings, dtype=float)
