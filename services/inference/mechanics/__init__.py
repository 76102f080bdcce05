"""Contact mechanics of a peg and a hole of any convex pieces: first contact, its geometry and its wrench (Eqs. 17-24),
and pushes with several contacts, friction and a compliant wrist."""

from services.inference.mechanics.contact_wrench import axial_share, contact_wrench_basis, sliding_direction
from services.inference.mechanics.features import ContactFeatures, ContactGeometry, contact_geometry
from services.inference.mechanics.first_contact import FirstContacts, PairContacts, first_contact, first_contacts
from services.inference.mechanics.near_contact import NearContacts, SurfacePair
from services.inference.mechanics.pairs import PairTables
from services.inference.mechanics.push import PushedPegs, PushSettings, push

__all__ = [
    "ContactFeatures",
    "ContactGeometry",
    "FirstContacts",
    "NearContacts",
    "PairContacts",
    "PairTables",
    "PushSettings",
    "PushedPegs",
    "SurfacePair",
    "axial_share",
    "contact_geometry",
    "contact_wrench_basis",
    "first_contact",
    "first_contacts",
    "push",
    "sliding_direction",
]
