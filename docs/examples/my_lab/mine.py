"""A strategy of one's own: push where vision saw the hole, then at places on a ring around it.

PYTHONPATH=docs/examples crosspih assemble --strategy my_lab.mine:RingSearch
"""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry import Pose
from crosspih_common.messages import PosePrior
from crosspih_common.strategy import Tools

RADIUS_M = 0.003
PLACES = 8


class RingSearch:
    """Where a push does not enter, eight others do the same a little beside it."""

    def assemble(self, tools: Tools) -> PosePrior:
        """Get the peg in."""
        seen = tools.locate()
        hole = seen.pose_base_hole.pose()
        belief = PosePrior(pose_base_hole=seen.pose_base_hole, covariance=seen.covariance)
        tools.approach(hole)
        if tools.push(hole):
            return belief
        for angle in np.arange(PLACES) * 2.0 * np.pi / PLACES:
            beside = hole @ Pose.from_translation([RADIUS_M * np.cos(angle), RADIUS_M * np.sin(angle), 0.0])
            tools.tell("a place on the ring", angle_deg=float(np.rad2deg(angle)))
            tools.withdraw(hole)
            tools.move_to(tools.before_hole(beside, 0.004))
            if tools.push(beside):
                return belief
        tools.give_up(f"{PLACES + 1} pushes did not enter")
