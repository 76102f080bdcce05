"""Pictures of a board drawn by OpenCV alone: our rectangles on a sheet, seen through its lens.

Nothing of the simulated cell's renderer is in it, so it is a witness: the ray of each of 3 x 3 sub-pixels (by
undistortPoints) is met with the board's plane, and the sheet is looked up there (by remap).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crosspih_common.config.board import BoardPattern
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraModel, DistortionModel
from services.vision.calibration.boards import NONE, Board, Corners
from services.vision.calibration.pairs import Pair
from services.vision.stereo import Camera

PATTERN = BoardPattern.of("7x5:0.018:0.012:DICT_4X4_50")
SIZE = (640, 480)
FINE, TEXEL_M, AROUND_M = 3, 0.00015, 0.006
DISTORTIONS = ((-0.082, 0.021, 0.0004, -0.0003), (-0.079, 0.019, -0.0002, 0.0005))
FOCAL_PX = ((381.36, 382.0), (379.5, 380.2))


def model(side: int, distortion: tuple[float, ...] | None = None) -> CameraModel:
    """The left camera (0) or the right one (1)."""
    numbers = DISTORTIONS[side] if distortion is None else distortion
    return CameraModel(
        width_px=SIZE[0], height_px=SIZE[1], fx_px=FOCAL_PX[side][0], fy_px=FOCAL_PX[side][1], cx_px=320.5, cy_px=240.5,
        distortion_model=DistortionModel.PLUMB_BOB if any(numbers) else DistortionModel.NONE,
        distortion=numbers if any(numbers) else (),
    )  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """Both cameras, and an arm that carries the board."""

    cameras: tuple[Camera, Camera]
    pose_left_right: Pose
    pose_base_camera: Pose
    pose_flange_board: Pose


def scene(distortion: tuple[float, ...] | None = None) -> Scene:
    """Two unequal cameras that are not parallel."""
    return Scene(
        (Camera.of(model(0, distortion)), Camera.of(model(1, distortion))),
        Pose.from_rotvec([0.01, -0.02, 0.015], [0.05, 0.001, -0.002]),
        Pose.from_rotvec([0.3, -0.4, 1.2], [0.1, -0.2, 0.3]),
        Pose.from_rotvec([0.2, 0.5, -0.3], [0.02, 0.05, 0.1]),
    )


def board_poses(rng: np.random.Generator, count: int, of: Scene, tilt_rad: float = 0.65) -> list[Pose]:
    """The board before both cameras, wholly in both pictures."""
    middle = np.append(PATTERN.size_m / 2.0, 0.0)
    found: list[Pose] = []
    while len(found) < count:
        away = rng.uniform(0.15, 0.32)
        at = np.array([*((rng.uniform([110.0, 90.0], [540.0, 390.0]) - [320.0, 240.0]) / 381.0), 1.0]) * away
        turn = Rotation.from_rotvec([*rng.uniform(-tilt_rad, tilt_rad, 2), 0.0])
        turn = turn * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-2.0, 2.0)])
        pose = Pose(turn.as_matrix(), at - turn.apply(middle))
        if all(_wholly(pose, of, side) for side in (0, 1)):
            found.append(pose)
    return found


def _wholly(pose_left_board: Pose, of: Scene, side: int) -> bool:
    pixels = of.cameras[side].project(_to(of, side).apply(pose_left_board.apply(PATTERN.outline_m())))
    return bool(np.all(pixels > 8.0) and np.all(pixels < np.array(SIZE) - 8.0))


def _to(of: Scene, side: int) -> Pose:
    return of.pose_left_right.inverse() if side else Pose.identity()


def corners(rng: np.random.Generator, poses: list[Pose], of: Scene, noise_px: float) -> list[Pair]:
    """What a detector would find, without a picture: exact corners with noise."""

    def seen(pose: Pose, side: int) -> Corners:
        pixels = of.cameras[side].project(_to(of, side).apply(pose.apply(PATTERN.corners_m())))
        pixels = pixels + rng.normal(size=pixels.shape) * noise_px
        inside = np.all((pixels > 5.0) & (pixels < np.array(SIZE) - 6.0), axis=1)
        if int(inside.sum()) < 6:
            return NONE
        return Corners(np.flatnonzero(inside).astype(np.int64), pixels[inside])

    return [(seen(pose, 0), seen(pose, 1)) for pose in poses]


def flanges(poses: list[Pose], of: Scene) -> list[Pose]:
    """`pose_base_flange` of an arm that holds the board so."""
    return [of.pose_base_camera @ pose @ of.pose_flange_board.inverse() for pose in poses]


def _sheet(board: Board) -> NDArray[np.float32]:
    width, height = np.ceil((PATTERN.size_m + 2 * AROUND_M) / TEXEL_M).astype(int)
    sheet = np.full((height, width), 210.0, dtype=np.float32)
    for left, top, across, down in board.black_m():
        first = np.rint((np.array([left, top]) + AROUND_M) / TEXEL_M).astype(int)
        last = np.rint((np.array([left + across, top + down]) + AROUND_M) / TEXEL_M).astype(int)
        sheet[first[1] : last[1], first[0] : last[0]] = 25.0
    return sheet


@lru_cache(maxsize=2)  # of a pair's cameras, which every picture of a scene is drawn for; 65 MB each
def _rays(fx_px: float, fy_px: float, cx_px: float, cy_px: float, *distortion: float) -> Array:
    """Of every sub-pixel, (n, 3), z = 1."""
    steps = (np.arange(FINE) + 0.5) / FINE - 0.5
    u = (np.arange(SIZE[0])[:, None] + steps).ravel()
    v = (np.arange(SIZE[1])[:, None] + steps).ravel()
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 1, 2)
    matrix = np.array([[fx_px, 0, cx_px], [0, fy_px, cy_px], [0, 0, 1.0]])
    slopes = np.asarray(cv2.undistortPoints(pixels, matrix, np.array(distortion) if distortion else None))
    return np.column_stack([slopes.reshape(-1, 2), np.ones(len(pixels))])


def draw(rng: np.random.Generator, pose_left_board: Pose, of: Scene, side: int, board: Board) -> NDArray[np.uint8]:
    """The picture of one camera, with blur and noise."""
    camera = of.cameras[side]
    pose = _to(of, side) @ pose_left_board
    rays = _rays(*(float(x) for x in (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, *camera.distortion)))
    rays = rays @ pose.rotation
    eye: Array = -pose.rotation.T @ pose.translation_m
    at = eye[:2] - rays[:, :2] * (eye[2] / rays[:, 2])[:, None]
    where = ((at + AROUND_M) / TEXEL_M - 0.5).astype(np.float32).reshape(FINE * SIZE[1], FINE * SIZE[0], 2)
    seen = cv2.remap(
        _sheet(board), where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=90.0
    )
    picture = cv2.resize(np.asarray(seen), SIZE, interpolation=cv2.INTER_AREA)
    blurred = cv2.GaussianBlur(picture, (0, 0), 0.6)
    return np.asarray(np.clip(np.rint(blurred + rng.normal(size=blurred.shape) * 2.0), 0, 255), dtype=np.uint8)
