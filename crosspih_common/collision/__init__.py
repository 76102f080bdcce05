"""How far the arm, its tool and the peg are from what stands around them, and whether a motion keeps clear of it."""

from crosspih_common.collision.fixture import Fixture
from crosspih_common.collision.model import Clearance, CollisionModel, Violation

__all__ = ["Clearance", "CollisionModel", "Fixture", "Violation"]
