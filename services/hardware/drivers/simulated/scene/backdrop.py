"""What is behind the plate: an even grey, or a wall of things at a distance, seen through a through hole as well."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.hardware.drivers.simulated.scene.lens import ImageWindow, Lens, plane_to_samples
from services.hardware.drivers.simulated.scene.scene_appearance import Appearance

FloatImage = NDArray[np.float32]

SIZE = 512
DISTANCES_M = (0.55, 1.2)
"""Of the wall from the left camera: behind the plate in every cell that is like the default one."""
THINGS, THING_SHARES = (12, 30), (0.02, 0.15)
SOFT = (1.0, 4.0)
BITS = 4
SPARE = 1.3


class Backdrop:
    """A wall square to the cameras' axes, that stands still in the base frame."""

    def __init__(self, rig: StereoRig, look: Appearance) -> None:
        self._grey = 255.0 * look.background_grey
        self._wall: FloatImage | None = None
        self._pose_base_wall = Pose.identity()
        self._reach_m = np.ones(2)
        if look.background != "cluttered":
            return
        rng = np.random.default_rng([look.marks_seed, 3])
        distance_m = rng.uniform(*DISTANCES_M)
        self._pose_base_wall = rig.pose_base_camera @ Pose.from_translation([0.0, 0.0, distance_m])
        farthest = max(rig.cx, rig.width - rig.cx) / rig.fx, max(rig.cy, rig.height - rig.cy) / rig.fy
        self._reach_m = SPARE * distance_m * np.array(farthest) + rig.baseline_m
        wall = np.full((SIZE, SIZE), self._grey, dtype=np.float32)
        for _ in range(int(rng.integers(*THINGS))):
            middle, half = rng.uniform(0.0, SIZE, 2), rng.uniform(*THING_SHARES, 2) * SIZE
            turn, grey = rng.uniform(0.0, 360.0), 255.0 * rng.uniform(0.03, 0.9)
            if rng.random() < 0.7:
                corners = cv2.boxPoints((middle.tolist(), (2.0 * half).tolist(), turn))
                cv2.fillPoly(wall, [np.rint(corners * 2**BITS).astype(np.int32)], grey, cv2.LINE_8, BITS)
            else:
                at, axes = np.rint(middle).astype(int).tolist(), np.rint(half).astype(int).tolist()
                cv2.ellipse(wall, at, axes, turn, 0.0, 360.0, grey, -1)
        # farther than what the lens is focused on
        self._wall = np.asarray(cv2.GaussianBlur(wall, (0, 0), rng.uniform(*SOFT)), dtype=np.float32)

    def in_window(self, lens: Lens, pose_base_camera: Pose, window: ImageWindow, samples: int) -> FloatImage | float:
        """Of a pinhole's picture, a part with `samples` x `samples` sub-pixels a pixel; one grey where it is even."""
        if self._wall is None:
            return self._grey
        size = (window.right - window.left) * samples, (window.bottom - window.top) * samples
        texel = 2.0 * self._reach_m / SIZE
        of_texel = np.array(
            [[texel[0], 0.0, 0.5 * texel[0] - self._reach_m[0]], [0.0, texel[1], 0.5 * texel[1] - self._reach_m[1]],
             [0.0, 0.0, 1.0]]
        )  # fmt: skip
        matrix = plane_to_samples(lens, pose_base_camera.inverse() @ self._pose_base_wall, window, samples) @ of_texel
        return np.asarray(cv2.warpPerspective(self._wall, matrix, size, borderMode=cv2.BORDER_REPLICATE), np.float32)
