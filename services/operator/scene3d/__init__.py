"""Pictures of the arm, the peg and the hole in space, drawn without a graphics card.

Needs OpenCV 5 (`triangleRasterize`); code that can do without the pictures asks `can_draw` first.
"""

from __future__ import annotations

from services.operator.scene3d.rasterising import Viewpoint, can_draw, draw

__all__ = ["Viewpoint", "can_draw", "draw"]
