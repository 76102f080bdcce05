"""Online use of the sensor: bias and gravity removed, moved to the peg frame, filtered; onset and drift watched.

All pure: each step takes its state and returns the next, so that a replay of a recording gives the same answers.
Wrenches are (Fx, Fy, Fz, Mx, My, Mz), N and Nm, the load on the peg.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from math import exp, pi

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from crosspih_common.geometry.pose import Array, Pose
from crosspih_common.geometry.wrench import transform_wrench
from services.force_torque.calibration import ToolParameters


def compensated(
    raw_sensor: ArrayLike,
    rotation_base_sensor: ArrayLike,
    tool: ToolParameters,
    pose_peg_sensor: Pose | None = None,
) -> Array:
    """The contact wrench (..., 6) on the peg, in the peg frame about its origin, from raw readings (..., 6).

    `rotation_base_sensor` is (3, 3) for all readings or (..., 3, 3) one each. `pose_peg_sensor` is the sensor's
    measuring frame in the peg frame (default: the same frame). Raises ValueError for a reading that is not finite.
    """
    raw = np.asarray(raw_sensor, dtype=float)
    if raw.shape[-1:] != (6,) or not np.all(np.isfinite(raw)):
        raise ValueError(f"raw_sensor wants shape (..., 6) and finite numbers, got shape {raw.shape}")
    contact = raw - tool.free_air_wrench(rotation_base_sensor)
    return contact if pose_peg_sensor is None else transform_wrench(pose_peg_sensor, contact)


@dataclass(frozen=True, slots=True)
class LowPass:
    """A first-order low-pass filter and its state: y += (1 - exp(-2 pi f T)) (x - y), exact for held inputs.

    `last` is the latest output (6,), None before the first sample, which passes unchanged.
    """

    cutoff_hz: float
    period_s: float
    last: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if not self.cutoff_hz > 0.0 or not self.period_s > 0.0:
            raise ValueError(
                f"LowPass wants cutoff_hz > 0 and period_s > 0, got {self.cutoff_hz} Hz and {self.period_s} s"
            )

    def filtered(self, wrenches: ArrayLike) -> tuple[LowPass, Array]:
        """The next state and the filtered samples (n, 6) of samples (n, 6) in order of time."""
        samples = np.atleast_2d(np.asarray(wrenches, dtype=float))
        if samples.shape[0] == 0:
            return self, samples
        gain = 1.0 - exp(-2.0 * pi * self.cutoff_hz * self.period_s)
        start = samples[0] if self.last is None else np.asarray(self.last)
        output, _ = lfilter([gain], [1.0, gain - 1.0], samples, axis=0, zi=(1.0 - gain) * start[None, :])
        return replace(self, last=tuple(output[-1].tolist())), np.asarray(output, dtype=float)


class ContactChange(str, Enum):
    """What a contact event says."""

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
    """Contact when |F| or |M| is above its threshold for `hold_samples` samples in a row, over when both are below
    `release_ratio` times their thresholds as long: the gap between the two keeps noise from toggling it.
    """

    force_threshold_n: float = 1.0
    moment_threshold_nm: float = 0.06
    release_ratio: float = 0.6
    hold_samples: int = 5

    def __post_init__(self) -> None:
        if self.force_threshold_n <= 0.0 or self.moment_threshold_nm <= 0.0:
            raise ValueError("OnsetSettings wants force_threshold_n and moment_threshold_nm above 0")
        if not 0.0 < self.release_ratio <= 1.0 or self.hold_samples < 1:
            raise ValueError("OnsetSettings wants 0 < release_ratio <= 1 and hold_samples >= 1")


@dataclass(frozen=True, slots=True)
class OnsetState:
    """Whether there is contact, and the run of samples that speaks against that: its length and its first sample."""

    in_contact: bool = False
    run_samples: int = 0
    run_stamp_ns: int = 0
    run_wrench: tuple[float, ...] = (0.0,) * 6


def watch_onset(
    state: OnsetState, settings: OnsetSettings, stamps_ns: ArrayLike, wrenches: ArrayLike
) -> tuple[OnsetState, list[ContactEvent]]:
    """The next state and the events in compensated samples (n, 6) with their stamps (n,), ns, in order of time."""
    samples = np.atleast_2d(np.asarray(wrenches, dtype=float))
    stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64)).tolist()
    if len(stamps) != len(samples):
        raise ValueError(f"{len(stamps)} stamps for {len(samples)} wrenches")
    level = np.maximum(
        np.linalg.norm(samples[:, :3], axis=1) / settings.force_threshold_n,
        np.linalg.norm(samples[:, 3:], axis=1) / settings.moment_threshold_nm,
    ).tolist()
    events: list[ContactEvent] = []
    for stamp, wrench, value in zip(stamps, samples, level, strict=True):
        against = value < settings.release_ratio if state.in_contact else value > 1.0
        if not against:
            state = replace(state, run_samples=0)
            continue
        if state.run_samples == 0:
            state = replace(state, run_stamp_ns=stamp, run_wrench=tuple(wrench.tolist()))
        state = replace(state, run_samples=state.run_samples + 1)
        if state.run_samples >= settings.hold_samples:
            change = ContactChange.ENDED if state.in_contact else ContactChange.BEGAN
            events.append(ContactEvent(change, state.run_stamp_ns, state.run_wrench))
            state = replace(state, in_contact=not state.in_contact, run_samples=0)
    return state, events


@dataclass(frozen=True, slots=True)
class FreeAirSettings:
    """The running mean forgets over `samples` samples; drift is a mean force or moment above its limit.

    The mean must rest on `samples` samples before it counts; `settle_samples` after a contact are left out. Samples
    far above the limit are not drift but contact or motion not yet noticed: above `gate_ratio` limits they are skipped.
    """

    samples: int = 500
    force_limit_n: float = 0.3
    moment_limit_nm: float = 0.015
    settle_samples: int = 200
    gate_ratio: float = 10.0

    def __post_init__(self) -> None:
        if self.samples < 1 or self.settle_samples < 0:
            raise ValueError("FreeAirSettings wants samples >= 1 and settle_samples >= 0")
        if self.force_limit_n <= 0.0 or self.moment_limit_nm <= 0.0 or self.gate_ratio <= 1.0:
            raise ValueError("FreeAirSettings wants force_limit_n, moment_limit_nm > 0 and gate_ratio > 1")


@dataclass(frozen=True, slots=True)
class FreeAirState:
    """The running mean (6,) of the compensated wrench in free air, and how many samples it rests on."""

    mean: tuple[float, ...] = (0.0,) * 6
    samples: int = 0
    settle_left: int = 0


@dataclass(frozen=True, slots=True)
class FreeAirReport:
    """Mean residual (6,), its force and moment magnitudes, and whether it rests on enough samples and has drifted."""

    mean: tuple[float, ...]
    force_n: float
    moment_nm: float
    settled: bool
    drifted: bool
    reason: str


def watch_free_air(
    state: FreeAirState, settings: FreeAirSettings, wrenches: ArrayLike, in_contact: bool
) -> tuple[FreeAirState, FreeAirReport]:
    """The next state and a report after compensated samples (n, 6); samples in contact are not counted."""
    samples = np.atleast_2d(np.asarray(wrenches, dtype=float))
    if in_contact:
        state = replace(state, settle_left=settings.settle_samples)
    else:
        skipped = min(state.settle_left, len(samples))
        state = replace(state, settle_left=state.settle_left - skipped)
        kept = samples[skipped:]
        level = np.maximum(
            np.linalg.norm(kept[:, :3], axis=1) / settings.force_limit_n,
            np.linalg.norm(kept[:, 3:], axis=1) / settings.moment_limit_nm,
        )
        mean, count = np.asarray(state.mean), state.samples
        for wrench in kept[level <= settings.gate_ratio]:
            count += 1
            mean = mean + (wrench - mean) / min(count, settings.samples)
        state = replace(state, mean=tuple(mean.tolist()), samples=count)
    return state, _report(state, settings)


def _report(state: FreeAirState, settings: FreeAirSettings) -> FreeAirReport:
    force = float(np.linalg.norm(state.mean[:3]))
    moment = float(np.linalg.norm(state.mean[3:]))
    settled = state.samples >= settings.samples
    faults = []
    if settled and force > settings.force_limit_n:
        faults.append(f"mean force in free air {force:.3f} N, limit {settings.force_limit_n:g} N")
    if settled and moment > settings.moment_limit_nm:
        faults.append(f"mean moment in free air {moment:.4f} Nm, limit {settings.moment_limit_nm:g} Nm")
    reason = "; ".join(faults) + ": calibrate the sensor again" if faults else ""
    return FreeAirReport(state.mean, force, moment, settled, bool(faults), reason)
