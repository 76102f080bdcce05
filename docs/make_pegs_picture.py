"""Draw docs/pegs.png: every named peg before the plate with its hole. Run from the project's root:

.venv/bin/python docs/make_pegs_picture.py
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pybullet
from numpy.typing import NDArray

from crosspih_common.config import PegDrawing, Workcell
from crosspih_common.config.drawing import OUTLINES
from crosspih_common.geometry import Pose
from services.hardware.drivers.simulated.scene.fixture_mesh import chamfer_meshes, fixture_meshes
from services.hardware.drivers.simulated.scene.scene_mesh import RenderMesh, convex_mesh

TILE_PX = 300
NAME_PX = 34
COLUMNS = 4
SAMPLES = 3
ORANGE, STEEL = (0.95, 0.5, 0.1), (0.80, 0.82, 0.85)
# in the hole's frame, whose z goes into the plate: the peg stands aside with its tip towards the eye
PLATE = Pose.from_translation([0.0, 0.052, 0.0])
PEG = Pose.from_rotvec([np.pi - 0.55, 0.0, 0.0], [0.0, -0.047, 0.03])
EYE_M, TARGET_M = (0.07, 0.02, -0.42), (0.0, -0.003, 0.0)


def _add(mesh: RenderMesh, pose: Pose, rgb: tuple[float, float, float]) -> None:
    shape = pybullet.createVisualShape(
        pybullet.GEOM_MESH,
        vertices=mesh.vertices_m.tolist(),
        indices=mesh.indices,
        normals=mesh.normals.tolist(),
        rgbaColor=[*rgb, 1.0],
    )
    pybullet.createMultiBody(0.0, -1, shape, pose.translation_m.tolist(), pose.quaternion_xyzw().tolist())


def tile(name: str) -> NDArray[np.uint8]:
    """The peg above its hole, (TILE_PX + NAME_PX, TILE_PX, 3), blue, green, red."""
    workcell = Workcell(peg=PegDrawing(outline=name))
    peg = workcell.peg.shape()
    pybullet.resetSimulation()
    hole = workcell.hole.shape(peg)
    fixture, chamfer = fixture_meshes(hole), [mesh for _, mesh in chamfer_meshes(hole)]
    _add(RenderMesh.merged([fixture["face"], fixture["sides"], fixture["bore"], *chamfer]), PLATE, STEEL)
    _add(convex_mesh(peg.pieces()), PEG, ORANGE)
    size = TILE_PX * SAMPLES
    _, _, rgba, depth, _ = pybullet.getCameraImage(
        size, size,
        pybullet.computeViewMatrix(EYE_M, TARGET_M, (0.0, -1.0, 0.0)),
        pybullet.computeProjectionMatrixFOV(30.0, 1.0, 0.05, 2.0),
        lightDirection=[0.5, -0.9, -1.4], lightAmbientCoeff=0.5, lightDiffuseCoeff=0.5, lightSpecularCoeff=0.0,
        shadow=0, renderer=pybullet.ER_TINY_RENDERER,
    )  # fmt: skip
    drawn = np.array(rgba, dtype=float).reshape(size, size, 4)[..., 2::-1]
    drawn[np.asarray(depth).reshape(size, size) >= 1.0] = 255.0
    picture = np.full((TILE_PX + NAME_PX, TILE_PX, 3), 255, dtype=np.uint8)
    picture[:TILE_PX] = drawn.reshape(TILE_PX, SAMPLES, TILE_PX, SAMPLES, 3).mean(axis=(1, 3)).round()
    (width, _), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, 0.7, 2)
    place = ((TILE_PX - width) // 2, TILE_PX + NAME_PX - 12)
    cv2.putText(picture, name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7, (40, 40, 40), 2, cv2.LINE_AA)
    return picture


def main() -> None:
    """All tiles in rows."""
    pybullet.connect(pybullet.DIRECT)
    tiles = [tile(name) for name in OUTLINES]
    rows = [np.hstack(tiles[start : start + COLUMNS]) for start in range(0, len(tiles), COLUMNS)]
    cv2.imwrite(str(Path(__file__).with_name("pegs.png")), np.vstack(rows))


if __name__ == "__main__":
    main()
