"""Draw docs/looks.png: what the default cell's left camera sees of twelve trials. Run from the project's root:

.venv/bin/python -m docs.make_looks_picture
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.config import load_cell
from crosspih_common.messages import CaptureStereo, ResetCell
from services.hardware.config import HardwareConfig
from services.hardware.hosting import open_cell

SEEDS = range(1000, 1012)
COLUMNS = 4
TILE_PX = (210, 180)
NAME_PX = 16


def main() -> None:
    """All tiles in rows, each around where the hole is expected."""
    cell = load_cell("deploy/cells/default.yaml").workcell
    camera = cell.camera
    at = (camera.pose_base_camera().inverse() @ cell.hole_prior.pose_base_hole()).translation_m
    middle = np.rint([camera.fx_px * at[0] / at[2] + camera.cx_px, camera.fy_px * at[1] / at[2] + camera.cy_px])
    left, top = np.clip(middle.astype(int) - np.array(TILE_PX) // 2, 0, [640 - TILE_PX[0], 480 - TILE_PX[1]])
    hosted = open_cell(cell, HardwareConfig(), realtime=False)
    tiles = []
    try:
        for seed in SEEDS:
            hosted.simulation.reset(ResetCell(seed=seed))
            seen = hosted.camera.capture(CaptureStereo()).left
            tile: NDArray[np.uint8] = np.full((TILE_PX[1] + NAME_PX, TILE_PX[0]), 255, dtype=np.uint8)
            tile[: TILE_PX[1]] = seen[top : top + TILE_PX[1], left : left + TILE_PX[0]]
            place = (4, TILE_PX[1] + NAME_PX - 4)
            cv2.putText(tile, f"seed {seed}", place, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 40, 1, cv2.LINE_AA)
            tiles.append(tile)
    finally:
        hosted.close()
    rows = [np.hstack(tiles[start : start + COLUMNS]) for start in range(0, len(tiles), COLUMNS)]
    target = Path(__file__).with_name("looks.png")
    cv2.imwrite(str(target), np.vstack(rows), [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
