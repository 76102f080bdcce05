"""The contacts behind the 26 contact states: the cross's taper edges against the sides of the hole's arms."""

from crosspih_common.contacts.arm_edges import ArmEdges, EdgeContacts, edge_index, sliding_wrench

__all__ = ["ArmEdges", "EdgeContacts", "edge_index", "sliding_wrench"]
