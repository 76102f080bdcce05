"""The current state of an assembly: phases with their times, forces and moments, touches, the estimate,
events. Pure.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from crosspih_common.messages import (
    AssemblyPhase,
    ContactWrench,
    Event,
    Phase,
    PoseData,
    PoseErrorEstimate,
    Severity,
    Touch,
)

HISTORY_S = 20.0
BUCKET_S = 0.25  # each value of the history is the largest in this time
EVENTS_KEPT = 3
ORDER = (
    Phase.CALIBRATING, Phase.LOCATING, Phase.APPROACHING, Phase.PUSHING, Phase.TOUCHING, Phase.ESTIMATING,
    Phase.CORRECTING, Phase.SEATED,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Caps:
    """|F| and |M| of contact above which the arm backs off."""

    force_n: float
    moment_nm: float


@dataclass(frozen=True, slots=True)
class Believed:
    """Where the hole is believed to be, and the source of the estimate; standard deviations across and along its axis,
    and of its tilt.
    """

    by: str
    position_mm: tuple[float, ...]
    sd_lateral_mm: float
    sd_depth_mm: float
    sd_tilt_deg: float


def believed(pose_base_hole: PoseData, covariance: tuple[float, ...], by: str) -> Believed:
    """From a pose and its (36,) covariance in the hole's frame, order x, y, z, rx, ry, rz."""
    sd = [math.sqrt(max(covariance[7 * index], 0.0)) for index in range(6)]
    return Believed(
        by=by,
        position_mm=tuple(value * 1e3 for value in pose_base_hole.position_m),
        sd_lateral_mm=math.hypot(sd[0], sd[1]) * 1e3,
        sd_depth_mm=sd[2] * 1e3,
        sd_tilt_deg=math.degrees(math.hypot(sd[3], sd[4])),
    )


@dataclass
class AssemblyStanding:
    """Fed with messages; times in s of the cell's clock since the assembly began."""

    title: str
    caps: Caps
    start_ns: int | None = None
    now_s: float = 0.0
    phase: Phase | None = None
    text: str = ""
    spent_s: dict[Phase, float] = field(default_factory=dict)
    wrench: tuple[float, ...] = (0.0,) * 6
    felt: bool = False
    peak_n: float = 0.0
    peak_nm: float = 0.0
    touches: int = 0
    presses: int = 0
    pushes: int = 0
    corrections: int = 0
    believed: Believed | None = None
    events: deque[str] = field(default_factory=lambda: deque(maxlen=EVENTS_KEPT))
    _since_s: float = 0.0
    _forces: dict[int, float] = field(default_factory=dict)
    _moments: dict[int, float] = field(default_factory=dict)

    def begin(self, now_ns: int) -> None:
        """The assembly begins; messages with an earlier stamp belong to another one."""
        self.start_ns = now_ns

    def _heard(self, stamp_ns: int) -> float | None:
        """The time of a message, s; None for one from before the assembly."""
        if self.start_ns is None or stamp_ns <= self.start_ns:
            return None
        at_s = (stamp_ns - self.start_ns) * 1e-9
        self.now_s = max(self.now_s, at_s)
        return at_s

    def add_phase(self, phase: AssemblyPhase) -> None:
        """A phase of the assembly."""
        at_s = self._heard(phase.stamp_ns)
        if at_s is None:
            return
        if self.phase is not None:
            self.spent_s[self.phase] = self.spent_s.get(self.phase, 0.0) + max(at_s - self._since_s, 0.0)
        changed, self.phase, self.text, self._since_s = phase.phase is not self.phase, phase.phase, phase.text, at_s
        self.pushes += changed and phase.phase is Phase.PUSHING
        self.corrections += phase.phase is Phase.CORRECTING
        figures = phase.figures
        if phase.phase is Phase.LOCATING and "sd_lateral_mm" in figures:
            self.believed = Believed(
                "vision", (), figures["sd_lateral_mm"], figures.get("sd_depth_mm", 0.0), figures.get("sd_tilt_deg", 0.0)
            )

    def in_phase_s(self, phase: Phase) -> float | None:
        """The duration of a phase up to now; None where it has not been entered."""
        running = self.now_s - self._since_s if phase is self.phase else None
        before = self.spent_s.get(phase)
        return None if running is None and before is None else (before or 0.0) + (running or 0.0)

    def add_wrench(self, felt: ContactWrench) -> None:
        """The contact wrench, peg frame. It is unknown until a calibration has ended."""
        at_s = self._heard(felt.stamp_ns)
        if at_s is None or self.phase is Phase.CALIBRATING:
            return
        self.wrench, self.felt = felt.wrench, True
        force_n, moment_nm = math.hypot(*felt.wrench[:3]), math.hypot(*felt.wrench[3:])
        self.peak_n, self.peak_nm = max(self.peak_n, force_n), max(self.peak_nm, moment_nm)
        bucket = int(at_s / BUCKET_S)
        for kept, value in ((self._forces, force_n), (self._moments, moment_nm)):
            kept[bucket] = max(kept.get(bucket, 0.0), value)
            for old in [one for one in kept if one < bucket - HISTORY_S / BUCKET_S]:
                del kept[old]

    def add_touch(self, touch: Touch) -> None:
        """A touch of the plate, or a press against a wall of the bore."""
        if self._heard(touch.stamp_ns) is not None:
            self.presses += touch.seated
            self.touches += not touch.seated

    def add_estimate(self, estimate: PoseErrorEstimate) -> None:
        """The estimate from the touches."""
        if self._heard(estimate.stamp_ns) is not None:
            self.believed = believed(estimate.pose_base_hole, estimate.covariance, estimate.method)

    def add_event(self, event: Event) -> None:
        """A warning or an error."""
        if self.start_ns is not None and event.severity is not Severity.INFO:
            self.events.append(f"{event.service}: {event.code}: {event.text}")

    def history(self, moments: bool = False) -> list[float]:
        """The largest |F| (N) or |M| (Nm) of each BUCKET_S of the last HISTORY_S, oldest first; 0 where none came."""
        kept = self._moments if moments else self._forces
        last = int(self.now_s / BUCKET_S)
        return [kept.get(bucket, 0.0) for bucket in range(last - int(HISTORY_S / BUCKET_S) + 1, last + 1)]
