"""Reads drawings: SVG and DXF files become curves, the curves one closed contour, the contour a peg's polygon."""

from crosspih_common.shapes.drawn.contour import Contour, contour_of
from crosspih_common.shapes.drawn.curves import Curve, DrawingRefused, Sheet

__all__ = ["Contour", "Curve", "DrawingRefused", "Sheet", "contour_of"]
