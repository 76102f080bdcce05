"""Speeds for touching, pressing and pushing that keep the forces small for any stiffness of arm and contact.

When the peg is in contact and the arm moves on at v, the force rises by k v each second, k the stiffness at the tip
of arm and contact in series. So three times limit the speed of a touch: the delay until a motion reacts to a force
(`REACTION_S`), the observation time while it creeps, and the delay of a yielding push, beyond which its loop of force,
speed and stiffness oscillates. The configured speeds are the fastest; a stiff cell gets slower ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import skew
from crosspih_common.geometry.pose import Array
from services.planning.config import PlanningConfig

REACTION_S = 0.005  # delay of the sensor's filter and transport, and two cycles of the arm
OBSERVE_S = 0.1  # observation time of a guarded move's creep
LOOP_PER_S = 250.0  # upper limit of a yielding push's loop gain k / D: its force feedback is some 4 ms late
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
        """Into the hole, where the peg meets slanted walls: twice as fast as towards the face."""
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
        """The damping of a push across its direction, N s/m."""
        return max(usual, self.across_n_m / LOOP_PER_S)

    def rotational_damping_nm_s_rad(self, usual: float) -> float:
        """The rotational damping of a push, Nm s/rad."""
        return max(usual, self.turn_nm_rad / LOOP_PER_S)
