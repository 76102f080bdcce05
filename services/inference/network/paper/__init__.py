"""The paper's network: one contact wrench to the three error angles, then x and y by the mechanics
(Sections 4.1-4.2)."""
