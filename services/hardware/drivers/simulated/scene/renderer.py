"""What draws the cell's meshes, in one of two ways: PyBullet's TinyRenderer, or the same in NumPy where it is missing.

Both take one sample in the lower left corner of each pixel, shade by ambient and diffuse light of one direction, and
cut greys off to whole numbers, so that a picture is the same but for single samples on edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.scene.scene_mesh import RenderMesh

Rgb = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One picture to draw: its size in pixels, OpenGL's matrices (16 numbers each, column-major), and the light.

    `to_light` (3,) points to the light, base frame; the coefficients are of a white surface's 255.
    """

    width: int
    height: int
    view_matrix: list[float]
    projection_matrix: list[float]
    to_light: Array
    ambient: float
    diffuse: float
    specular: float = 0.0
    shadow: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """Colours (height, width, 3), and the body that is seen (height, width): its number, below 0 where nothing is."""

    rgb: NDArray[np.uint8]
    body: NDArray[np.int32]

    @property
    def empty(self) -> NDArray[np.bool_]:
        """Where nothing is (height, width)."""
        return self.body < 0


class Renderer(Protocol):
    """Bodies, white and at the origin when they are added, and pictures of them. One thread at a time."""

    def add(self, mesh: RenderMesh) -> int:
        """A new body; its number."""

    def place(self, body: int, pose_base_body: Pose) -> None:
        """Put a body somewhere."""

    def colour(self, body: int, rgb: Rgb) -> None:
        """Paint a body, 0 to 1 a channel."""

    def draw(self, view: View) -> Drawn:
        """A picture."""

    def close(self) -> None:
        """Give back what was taken; a second call does nothing."""


def open_renderer() -> Renderer:
    """The fastest renderer that is installed."""
    if find_spec("pybullet") is not None:
        from services.hardware.drivers.simulated.scene.tiny_renderer import TinyRenderer

        return TinyRenderer()
    from services.hardware.drivers.simulated.scene.numpy_renderer import NumpyRenderer

    return NumpyRenderer()
