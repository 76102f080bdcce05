"""Online evaluation of the contact wrench: contacts that begin and end, and drift in free air.

All pure: each step takes a state and returns the next, so that a replay of a recording gives the same answers.
Wrenches are (Fx, Fy, Fz, Mx, My, Mz), N and Nm, the load on the peg.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike


class ContactChange(str, Enum):
    """The kind of a contact event."""

    BEGAN = "began"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class ContactEvent:
    """A contact began or ended: the stamp of the first sample that showed it, and that sample's wrench (6,)."""

    change: ContactChange
    stamp_ns: int
    wrench: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class OnsetSettings:
    """Contact begins when |F| or |M| is above its threshold for `hold_s` without a break. It ends when both are below
    `release_ratio` times their thresholds for as long; this hysteresis keeps noise from toggling it. One sample of a
    slow sensor is never enough: it takes two.
    """

    force_threshold_n: float = 1.0
    moment_threshold_nm: float = 0.06
    release_ratio: float = 0.6
    hold_s: float = 0.005

    def __post_init__(self) -> None:
        if self.force_threshold_n <= 0.0 or self.moment_threshold_nm <= 0.0:
            raise ValueError("OnsetSettings wants force_threshold_n and moment_threshold_nm above 0")
        if not 0.0 < self.release_ratio <= 1.0 or not 0.0 < self.hold_s < 10.0:
            raise ValueError("OnsetSettings wants 0 < release_ratio <= 1 and hold_s above 0 and below 10")

    def hold_samples(self, period_s: float) -> int:
        """The number of consecutive samples for a sensor of that period."""
        return max(2, round(self.hold_s / period_s))


@dataclass(frozen=True, slots=True)
class OnsetState:
    """Whether there is contact, and the run of samples that contradict it: its length and its first sample."""

    in_contact: bool = False
    run_samples: int = 0
    run_stamp_ns: int = 0
    run_wrench: tuple[float, ...] = (0.0,) * 6


def watch_onset(
    state: OnsetState, settings: OnsetSettings, stamps_ns: ArrayLike, wrenches: ArrayLike, period_s: float
) -> tuple[OnsetState, list[ContactEvent]]:
    """The next state and the events in contact wrenches (n, 6), one every `period_s`, with their stamps (n,), ns."""
    samples = np.atleast_2d(np.asarray(wrenches, dtype=float))
    stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64)).tolist()
    if len(stamps) != len(samples):
        raise ValueError(f"{len(stamps)} stamps for {len(samples)} wrenches")
    level = np.maximum(
        np.linalg.norm(samples[:, :3], axis=1) / settings.force_threshold_n,
        np.linalg.norm(samples[:, 3:], axis=1) / settings.moment_threshold_nm,
    ).tolist()
    hold_samples = settings.hold_samples(period_s)
    events: list[ContactEvent] = []
    in_contact, run = state.in_contact, state.run_samples
    run_stamp_ns, run_wrench = state.run_stamp_ns, state.run_wrench
    for index, value in enumerate(level):
        against = value < settings.release_ratio if in_contact else value > 1.0
        if not against:
            run = 0
            continue
        if run == 0:
            run_stamp_ns, run_wrench = stamps[index], tuple(samples[index].tolist())
        run += 1
        if run >= hold_samples:
            events.append(
                ContactEvent(ContactChange.ENDED if in_contact else ContactChange.BEGAN, run_stamp_ns, run_wrench)
            )
            in_contact, run = not in_contact, 0
    return OnsetState(in_contact, run, run_stamp_ns, run_wrench), events


@dataclass(frozen=True, slots=True)
class FreeAirSettings:
    """The running mean has the time constant `mean_s`; drift is a mean force or moment above its limit.

    The mean counts only after `mean_s` of samples; `settle_s` after a contact are left out. Samples far above the limit
    are not drift but unnoticed contact or motion: above `gate_ratio` limits they are skipped.
    """

    mean_s: float = 0.5
    force_limit_n: float = 0.3
    moment_limit_nm: float = 0.015
    settle_s: float = 0.2
    gate_ratio: float = 10.0

    def __post_init__(self) -> None:
        if not self.mean_s > 0.0 or not self.settle_s >= 0.0:
            raise ValueError("FreeAirSettings wants mean_s above 0 and settle_s of 0 or more")
        if self.force_limit_n <= 0.0 or self.moment_limit_nm <= 0.0 or self.gate_ratio <= 1.0:
            raise ValueError("FreeAirSettings wants force_limit_n, moment_limit_nm > 0 and gate_ratio > 1")


@dataclass(frozen=True, slots=True)
class FreeAirState:
    """The running mean (6,) of the contact wrench in free air, and the number of its samples."""

    mean: tuple[float, ...] = (0.0,) * 6
    samples: int = 0
    settle_left: int = 0


@dataclass(frozen=True, slots=True)
class FreeAirReport:
    """Mean residual (6,), its force and moment magnitudes, and whether it has enough samples and has drifted."""

    mean: tuple[float, ...]
    force_n: float
    moment_nm: float
    settled: bool
    drifted: bool
    reason: str


def watch_free_air(
    state: FreeAirState, settings: FreeAirSettings, wrenches: ArrayLike, in_contact: bool, period_s: float
) -> tuple[FreeAirState, FreeAirReport]:
    """The next state and a report after contact wrenches (n, 6), one every `period_s`; none counts if `in_contact`."""
    samples = np.atleast_2d(np.asarray(wrenches, dtype=float))
    enough = max(1, round(settings.mean_s / period_s))
    if in_contact:
        state = replace(state, settle_left=round(settings.settle_s / period_s))
    else:
        skipped = min(state.settle_left, len(samples))
        state = replace(state, settle_left=state.settle_left - skipped)
        kept = samples[skipped:]
        level = np.maximum(
            np.linalg.norm(kept[:, :3], axis=1) / settings.force_limit_n,
            np.linalg.norm(kept[:, 3:], axis=1) / settings.moment_limit_nm,
        )
        # in plain floats: for six numbers per sample, a NumPy call costs more than the sums
        mean, count = list(state.mean), state.samples
        for wrench in kept[level <= settings.gate_ratio].tolist():
            count += 1
            share = min(count, enough)
            mean = [was + (felt - was) / share for was, felt in zip(mean, wrench, strict=True)]
        state = replace(state, mean=tuple(mean), samples=count)
    return state, _report(state, settings, enough)


def _report(state: FreeAirState, settings: FreeAirSettings, enough: int) -> FreeAirReport:
    force = float(np.linalg.norm(state.mean[:3]))
    moment = float(np.linalg.norm(state.mean[3:]))
    settled = state.samples >= enough
    faults = []
    if settled and force > settings.force_limit_n:
        faults.append(f"mean force in free air {force:.3f} N, limit {settings.force_limit_n:g} N")
    if settled and moment > settings.moment_limit_nm:
        faults.append(f"mean moment in free air {moment:.4f} Nm, limit {settings.moment_limit_nm:g} Nm")
    reason = "; ".join(faults) + ": calibrate the sensor again" if faults else ""
    return FreeAirReport(state.mean, force, moment, settled, bool(faults), reason)
