"""The pegs and holes that the simulator, vision and the contact mechanics share."""

from crosspih_common.shapes.convex import ConvexPiece
from crosspih_common.shapes.cover import ConvexRegion
from crosspih_common.shapes.cross import CrossHole, CrossPeg, cross_outline
from crosspih_common.shapes.hole import Hole
from crosspih_common.shapes.outline import Outline
from crosspih_common.shapes.peg import Peg

__all__ = ["ConvexPiece", "ConvexRegion", "CrossHole", "CrossPeg", "Hole", "Outline", "Peg", "cross_outline"]
