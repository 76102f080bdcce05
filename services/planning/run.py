"""One assembly under way: what all strategies are handed."""

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
    """One assembly: where the peg is and how it moves (`motion`), where the hole is believed (`hole`), what was counted
    (`counts`) and felt (`touches`, `presses`), and how a step is told (`tell`)."""

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
