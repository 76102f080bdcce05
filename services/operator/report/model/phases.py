"""The steps of the assembly in order, and the duration of each phase."""

from __future__ import annotations

from dataclasses import dataclass

from crosspih_common.messages import AssemblyPhase, Phase
from services.operator.report.model.window import AssemblyWindow


@dataclass(frozen=True, slots=True)
class Span:
    """One step, s of cell time since the command, and its duration in s of the recorder's clock."""

    message: AssemblyPhase
    start_s: float
    end_s: float
    wall_s: float

    @property
    def took_s(self) -> float:
        """The duration in cell time."""
        return self.end_s - self.start_s


@dataclass(frozen=True, slots=True)
class PhaseTime:
    """All steps of one phase together."""

    phase: Phase
    steps: int
    cell_s: float
    wall_s: float
    share: float  # share of the whole cell time


def spans_of(window: AssemblyWindow) -> list[Span]:
    """Each step until the next one begins, the last until the assembly's end."""
    spans = []
    for index, (message, wall_ns) in enumerate(window.phases):
        last = index + 1 == len(window.phases)
        until_ns = window.end_ns if last else window.phases[index + 1][0].stamp_ns
        until_wall_ns = wall_ns if last else window.phases[index + 1][1]
        spans.append(
            Span(message, window.s(message.stamp_ns), window.s(until_ns), max(0.0, (until_wall_ns - wall_ns) * 1e-9))
        )
    return spans


def times_of(spans: list[Span]) -> list[PhaseTime]:
    """By phase, in the order in which each first began."""
    total_s = sum(span.took_s for span in spans)
    found = []
    for phase in dict.fromkeys(span.message.phase for span in spans):
        of_it = [span for span in spans if span.message.phase is phase]
        cell_s = sum(span.took_s for span in of_it)
        share = cell_s / total_s if total_s > 0.0 else 0.0
        found.append(PhaseTime(phase, len(of_it), cell_s, sum(span.wall_s for span in of_it), share))
    return found


def calibrated_until_s(spans: list[Span]) -> float:
    """When the sensor's calibration at the beginning ended, s since the command; 0 where there was none."""
    return max((span.end_s for span in spans if span.message.phase is Phase.CALIBRATING), default=0.0)
