"""A ChArUco board on the flange: a thin white plate with what is printed on it, by its plane's exact projection."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.config.board import BoardPattern
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from services.hardware.drivers.simulated.config import BoardConfig
from services.hardware.drivers.simulated.scene.lens import FloatImage, ImageWindow, Lens, plane_to_samples
from services.hardware.drivers.simulated.scene.scene_mesh import RenderMesh, box_mesh

TEXELS = 48  # a square's side
THICK_M = 0.003
PAPER_GREY, INK = 0.9, np.float32(0.08)


@dataclass(frozen=True, slots=True, eq=False)
class ShownBoard:
    """`ink` (rows, columns): 1 where the paper is bare; its first texel's corner is `margin_m` before the origin."""

    pattern: BoardPattern
    pose_flange_board: Pose
    margin_m: float
    ink: FloatImage

    @classmethod
    def of(cls, config: BoardConfig) -> ShownBoard:
        """As the cell's file says. Raises ConfigError for a dictionary that has no such name, or too few markers."""
        pattern = BoardPattern.of(config.pattern)
        number = getattr(cv2.aruco, pattern.dictionary, None)
        if number is None:
            raise ConfigError(f"hardware.simulated.board.pattern: OpenCV has no dictionary {pattern.dictionary}")
        try:
            board = cv2.aruco.CharucoBoard(
                (pattern.columns, pattern.rows), pattern.square_m, pattern.marker_m,
                cv2.aruco.getPredefinedDictionary(number),
            )  # fmt: skip
            drawn = board.generateImage((pattern.columns * TEXELS, pattern.rows * TEXELS))
        except cv2.error as error:
            raise ConfigError(f"hardware.simulated.board.pattern: {error}") from None
        around = round(config.margin_m / pattern.square_m * TEXELS)
        wide = cv2.copyMakeBorder(drawn, around, around, around, around, cv2.BORDER_CONSTANT, value=255)
        ink = np.where(np.asarray(wide) > 127, np.float32(1.0), INK)
        return cls(pattern, config.pose_flange_board.pose(), around * pattern.square_m / TEXELS, ink)

    def mesh(self) -> RenderMesh:
        """The plate in the board's frame, its printed face at z = 0."""
        width, height = self.pattern.size_m
        half = (width / 2 + self.margin_m, height / 2 + self.margin_m, THICK_M / 2)
        return box_mesh(half, (width / 2, height / 2, THICK_M / 2))

    def print_on(
        self, grey: FloatImage, seen: NDArray[np.bool_], lens: Lens, pose_camera_board: Pose, window: ImageWindow,
        samples: int,
    ) -> None:  # fmt: skip
        """Darken the sub-pixels of a window that see the plate (`seen`) where there is ink; from behind none is."""
        rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
        if not len(rows) or float(pose_camera_board.rotation[:, 2] @ pose_camera_board.translation_m) <= 0.0:
            return
        texel = self.pattern.square_m / TEXELS
        start = 0.5 * texel - self.margin_m
        of_texel = np.array([[texel, 0.0, start], [0.0, texel, start], [0.0, 0.0, 1.0]])
        top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
        to_part = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]])
        matrix = to_part @ plane_to_samples(lens, pose_camera_board, window, samples) @ of_texel
        printed = cv2.warpPerspective(
            self.ink, matrix, (int(right - left), int(bottom - top)), borderMode=cv2.BORDER_CONSTANT, borderValue=1.0
        )
        part = np.s_[top:bottom, left:right]
        grey[part] *= np.where(seen[part], printed, np.float32(1.0))
