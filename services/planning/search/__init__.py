"""Finding a hole by feel: what a contact with the face tells, and where the hole can still be."""

from services.planning.search.belief import HoleBelief
from services.planning.search.face import FaceContact, FacePlane, face_contact
from services.planning.search.outline_field import OutlineField

__all__ = ["FaceContact", "FacePlane", "HoleBelief", "OutlineField", "face_contact"]
