"""The state of one assembly under way, which is passed to all strategies."""

from __future__ import annotations

from crosspih_common.config import Workcell
from crosspih_common.messages import StopReason, Touch
from services.planning.config import PlanningConfig
from services.planning.counts import AssemblyCounts
from services.planning.hole_knowledge import HoleKnowledge
from services.planning.moving import PegMotion
from services.planning.ports import Ports
from services.planning.telling import PhaseTeller


class Run:
    """One assembly: the peg's pose and motions (`motion`), the estimated hole (`hole`), the counts (`counts`), the
    contacts (`touches`, `presses`), and the publisher of steps (`tell`)."""

    def __init__(self, workcell: Workcell, config: PlanningConfig, ports: Ports, assembly_id: str) -> None:
        self.workcell, self.config, self.ports = workcell, config, ports
        self.assembly_id = assembly_id
        self.counts = AssemblyCounts()
        self.tell = PhaseTeller(ports, assembly_id, self.counts)
        self.motion = PegMotion(workcell, config, ports, self.counts, self.tell)
        self.hole = HoleKnowledge(workcell)
        self.touches: list[Touch] = []
        self.presses: list[Touch] = []
        self.last_stop = StopReason.COMPLETED  # of the last touch
