"""How fast to touch, press and push, so that what is felt stays small whatever the stiffness of arm and contact.

Where the peg meets something while the arm goes on at v, the force rises by k v each second, k the stiffness at the tip
of arm and contact in series. So a touch is led by three times: how late a motion hears of a force (`REACTION_S`), how
long it observes while it creeps, and how late a push that yields answers, beyond which its loop of force, speed and
stiffness swings. The configured speeds are the fastest; a stiff cell gets slower ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import skew
from crosspih_common.geometry.pose import Array
from services.planning.config import PlanningConfig

REACTION_S = 0.005  # sensor's filter and transport, and two cycles of the arm
OBSERVE_S = 0.1  # of a guarded move's creep
LOOP_PER_S = 250.0  # the most that a yielding push may answer with, k / D: it hears of a force some 4 ms later
WALLS = 2  # contacts that share a moment


@dataclass(frozen=True, slots=True)
class Gentle:
    """The stiffness of arm and contact at the tip, in one posture: along the peg's axis, the stiffest across it, N/m,
    and the stiffest to turn, Nm/rad."""

    along_n_m: float
    across_n_m: float
    turn_nm_rad: float

    @classmethod
    def at(cls, workcell: Workcell, joints_rad: Array) -> Gentle:
        """At joints (n,)."""
        peg = workcell.peg.shape()
        to_tip = np.eye(6)
        to_tip[:3, 3:] = -skew([0.0, 0.0, peg.tip_m])
        at_tip = to_tip @ workcell.compliance_peg(joints_rad) @ to_tip.T
        softest_turn = float(np.linalg.eigvalsh(at_tip[3:, 3:])[0])
        if workcell.contact_stiffness_n_m is not None:
            lever_m = float(np.linalg.norm(peg.outline_m(peg.taper_start_m)[:, :2], axis=1).max())
            softest_turn += 1.0 / (WALLS * workcell.contact_stiffness_n_m * lever_m**2)
        return cls(
            along_n_m=1.0 / float(at_tip[2, 2]),
            across_n_m=1.0 / float(np.linalg.eigvalsh(at_tip[:2, :2])[0]),
            turn_nm_rad=1.0 / softest_turn,
        )

    def probe_speed_m_s(self, config: PlanningConfig) -> float:
        """Towards where the face may be."""
        return min(config.probe_speed_m_s, config.touch_reaction_n / (self.along_n_m * REACTION_S))

    def touch_speed_m_s(self, config: PlanningConfig, wanted_m_s: float) -> float:
        """Into the hole, where walls at a slant are met: twice as fast as towards the face."""
        return min(wanted_m_s, 2.0 * config.touch_reaction_n / (self.along_n_m * REACTION_S))

    def creep_m_s(self, config: PlanningConfig) -> float:
        """While a touch is observed."""
        return min(config.touch_creep_m_s, config.touch_adds_n / (self.along_n_m * OBSERVE_S))

    def press_creep_m_s(self, config: PlanningConfig) -> float:
        """While a press against a wall of the bore is observed."""
        return min(config.press_creep_m_s, config.press_force_n / (self.across_n_m * OBSERVE_S))

    def push_speed_m_s(self, config: PlanningConfig, force_n: float) -> float:
        """Along the hole's axis: the push slows from this speed to none over `force_n`."""
        return min(config.push_speed_m_s, LOOP_PER_S * force_n / self.along_n_m)

    def lateral_damping_n_s_m(self, usual: float) -> float:
        """How much a push gives way to what it feels across."""
        return max(usual, self.across_n_m / LOOP_PER_S)

    def rotational_damping_nm_s_rad(self, usual: float) -> float:
        """How much a push gives way to a moment."""
        return max(usual, self.turn_nm_rad / LOOP_PER_S)
