"""The parametric peg and hole that the simulator, vision and the contact mechanics share."""

from crosspih_common.shapes.convex import ConvexPiece
from crosspih_common.shapes.cross import CrossHole, CrossPeg, cross_outline

__all__ = ["ConvexPiece", "CrossHole", "CrossPeg", "cross_outline"]
