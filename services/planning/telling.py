"""The steps of an assembly, told to whoever watches."""

from __future__ import annotations

from crosspih_common.messages import AssemblyPhase, Phase
from services.planning.counts import AssemblyCounts
from services.planning.ports import Ports


class PhaseTeller:
    """Publishes a step of one assembly: `tell(Phase.PUSHING, "push 1", push_force_n=20.0)`."""

    def __init__(self, ports: Ports, assembly_id: str, counts: AssemblyCounts) -> None:
        self._ports, self._assembly_id, self._counts = ports, assembly_id, counts

    def __call__(self, phase: Phase, text: str, **figures: float) -> None:
        """Publish it, with the number of the attempt and figures rounded to six digits."""
        self._ports.publish_phase(
            AssemblyPhase(
                assembly_id=self._assembly_id,
                phase=phase,
                attempt=self._counts.attempt,
                text=text,
                figures={name: round(float(value), 6) for name, value in figures.items()},
            )
        )
