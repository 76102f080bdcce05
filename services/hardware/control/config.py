"""What the control layer keeps to, whatever it is told: the `hardware.limits` section of a cell's file."""

from __future__ import annotations

from pydantic import Field

from crosspih_common.config.section import Section
from services.hardware.protocols import Landing

STRICT_LANDING = Landing(moved_mass_kg=30.0, contact_stiffness_n_m=1e8)
"""For a cell that says nothing: all that moves of an arm, behind the stiffest wrist sensor. docs/safety.md."""


class LimitsConfig(Section):
    """Caps, what they are derived from, and what ends a motion. docs/safety.md has the derivation."""

    force_cap_n: float = Field(default=60.0, gt=0.0, le=500.0, description="|F| of contact at which the arm backs off")
    moment_cap_nm: float = Field(default=6.0, gt=0.0, le=50.0, description="|M| about the peg frame's origin, likewise")
    # how hard a peg lands: v sqrt(k m). Left out, they are the driver's, or `STRICT_LANDING`.
    moved_mass_kg: float | None = Field(
        default=None, gt=0.0, le=200.0, description="what of the arm and its tool stops with the tip that hits"
    )
    contact_stiffness_n_m: float | None = Field(
        default=None, gt=1e3, le=1e9, description="of a hard contact: peg, plate and what holds them, in series"
    )
    sensor_delay_s: float = Field(
        default=0.002, ge=0.0, le=0.05, description="from a force to its sample in the loop: filter and transport"
    )
    braking_m_s2: float = Field(default=5.0, gt=0.05, le=50.0, description="how fast the tip slows down at contact")
    free_braking_m_s2: float = Field(
        default=1.0, gt=0.05, le=50.0, description="how fast a free move slows down as it nears the fixture"
    )
    clear_out_m_s: float = Field(
        default=0.03, gt=0.0, le=0.25, description="straight back along the peg's axis: nothing stands behind it"
    )
    holder_timeout_s: float = Field(
        default=0.1, ge=0.02, le=5.0, description="without a beat of its holder for so long the arm stops"
    )
    sensor_timeout_s: float = Field(
        default=0.05, gt=0.0, le=1.0, description="without a sample for so long the arm stops"
    )
    missed_cycles: int = Field(default=20, ge=1, le=10000, description="of one motion; with more of them the arm stops")
    motion_s: float = Field(default=120.0, gt=0.0, le=600.0, description="longest motion that is accepted")

    def landing(self, declared: Landing | None) -> tuple[Landing, tuple[str, ...]]:
        """What a landing is reckoned with: of the cell's file, else what the driver declares, else `STRICT_LANDING`.

        With it the names of the settings that nobody gave.
        """
        known = declared or STRICT_LANDING
        given = (self.moved_mass_kg, self.contact_stiffness_n_m)
        names = ("moved_mass_kg", "contact_stiffness_n_m")
        missing = () if declared else tuple(name for name, value in zip(names, given, strict=True) if value is None)
        mass_kg, stiffness_n_m = given
        return Landing(
            known.moved_mass_kg if mass_kg is None else mass_kg,
            known.contact_stiffness_n_m if stiffness_n_m is None else stiffness_n_m,
        ), missing
