"""Drawings read: SVG and DXF files become curves, curves one closed contour, a contour the polygon of a peg."""

from crosspih_common.shapes.drawn.contour import Contour, contour_of
from crosspih_common.shapes.drawn.curves import Curve, DrawingRefused, Sheet

__all__ = ["Contour", "Curve", "DrawingRefused", "Sheet", "contour_of"]
