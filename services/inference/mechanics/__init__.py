"""Contact mechanics of the cross peg and hole: first contact, its geometry and its wrench (Eqs. 17-24)."""

from services.inference.mechanics.contact_wrench import axial_share, contact_wrench_basis, sliding_direction
from services.inference.mechanics.features import ContactFeatures, ContactGeometry, contact_geometry
from services.inference.mechanics.first_contact import PairContacts, first_contacts
from services.inference.mechanics.pairs import PairTables

__all__ = [
    "ContactFeatures",
    "ContactGeometry",
    "PairContacts",
    "PairTables",
    "axial_share",
    "contact_geometry",
    "contact_wrench_basis",
    "first_contacts",
    "sliding_direction",
]
