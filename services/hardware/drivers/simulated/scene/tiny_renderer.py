"""Pictures by PyBullet's TinyRenderer, on a client of its own, which never steps."""

from __future__ import annotations

import numpy as np
import pybullet

from crosspih_common.geometry import Pose
from services.hardware.drivers.simulated.scene.renderer import Drawn, Rgb, View
from services.hardware.drivers.simulated.scene.scene_mesh import RenderMesh


class TinyRenderer:
    """Implements the Renderer protocol. PyBullet is not thread-safe."""

    def __init__(self) -> None:
        self._client = int(pybullet.connect(pybullet.DIRECT))

    def close(self) -> None:
        """Give the client back; a second call does nothing."""
        if self._client >= 0:
            pybullet.disconnect(physicsClientId=self._client)
            self._client = -1

    def add(self, mesh: RenderMesh) -> int:
        """A new body; its number."""
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=mesh.vertices_m.tolist(),
            indices=mesh.indices,
            normals=mesh.normals.tolist(),
            rgbaColor=[1.0, 1.0, 1.0, 1.0],
            physicsClientId=self._client,
        )
        return int(pybullet.createMultiBody(0.0, -1, shape, physicsClientId=self._client))

    def place(self, body: int, pose_base_body: Pose) -> None:
        """Put a body somewhere."""
        pybullet.resetBasePositionAndOrientation(
            body, pose_base_body.translation_m.tolist(), pose_base_body.quaternion_xyzw().tolist(),
            physicsClientId=self._client,
        )  # fmt: skip

    def colour(self, body: int, rgb: Rgb) -> None:
        """Paint a body, 0 to 1 a channel."""
        pybullet.changeVisualShape(body, -1, rgbaColor=[*rgb, 1.0], physicsClientId=self._client)

    def draw(self, view: View) -> Drawn:
        """A picture."""
        _, _, rgba, _, body = pybullet.getCameraImage(
            view.width, view.height, view.view_matrix, view.projection_matrix,
            lightDirection=np.asarray(view.to_light, float).tolist(),
            lightColor=[1.0, 1.0, 1.0],
            lightAmbientCoeff=view.ambient,
            lightDiffuseCoeff=view.diffuse,
            lightSpecularCoeff=view.specular,
            shadow=int(view.shadow),
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )  # fmt: skip
        shape = view.height, view.width
        return Drawn(
            np.asarray(rgba, dtype=np.uint8).reshape(*shape, 4)[..., :3],
            np.asarray(body, dtype=np.int32).reshape(shape),
        )
