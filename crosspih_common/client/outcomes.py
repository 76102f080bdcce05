"""What a client is answered: how an assembly ended, and how a cell is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from crosspih_common.messages import (
    AssemblyResult,
    ServiceStatus,
)


@dataclass(frozen=True, slots=True)
class Assembly:
    """An assembly that came to an end.

    `result` is the planner's own account: T2 and every count, with units in the names of its fields. `seed` is what the
    trial was drawn from, None where nothing was drawn; `wall_s` the wall time of the whole. `recording` is the first
    file of the recording, `recording_parts` all of them, `recording_warnings` what is missing from it.
    """

    result: AssemblyResult
    seed: int | None
    wall_s: float
    recording: Path | None
    recording_parts: tuple[Path, ...]
    recording_warnings: tuple[str, ...]

    @property
    def inserted(self) -> bool:
        """Whether the peg is in, by the planner's word."""
        return self.result.inserted


@dataclass(frozen=True, slots=True)
class CellStatus:
    """How a cell is. `alive` are the services with a sign of life, `services` what each said last (once a second);
    `holder` is who holds the arm, empty where nobody does."""

    cell: str
    endpoint: str
    simulated: bool
    speed: str
    alive: frozenset[str]
    services: dict[str, ServiceStatus]
    holder: str
    holding_for: str
