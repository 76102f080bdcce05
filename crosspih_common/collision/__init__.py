"""Distances of the arm, its tool and the peg from their surroundings, and collision checks of motions."""

from crosspih_common.collision.fixture import Fixture
from crosspih_common.collision.model import Clearance, CollisionModel, Violation

__all__ = ["Clearance", "CollisionModel", "Fixture", "Violation"]
