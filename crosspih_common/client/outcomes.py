"""The results that a client returns: how an assembly ended, and the state of a cell."""

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

    `result` is the planner's own account: T2 and every count, with units in the names of its fields. `seed` is the seed
    of the trial, None if none was drawn; `wall_s` the wall time of the whole. `recording` is the first file of the
    recording, `recording_parts` are all its files, `recording_warnings` says what is missing from it.
    """

    result: AssemblyResult
    seed: int | None
    wall_s: float
    recording: Path | None
    recording_parts: tuple[Path, ...]
    recording_warnings: tuple[str, ...]

    @property
    def inserted(self) -> bool:
        """Whether the peg is in, according to the planner."""
        return self.result.inserted


@dataclass(frozen=True, slots=True)
class CellStatus:
    """The state of a cell. `alive` are the services with a liveliness token, `services` their last statuses (one a
    second); `holder` is the holder of the arm, empty if there is none."""

    cell: str
    endpoint: str
    simulated: bool
    speed: str
    alive: frozenset[str]
    services: dict[str, ServiceStatus]
    holder: str
    holding_for: str
