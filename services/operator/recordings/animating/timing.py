"""Which moments of an assembly an animation shows: few of the ways through air, many of the contacts. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosspih_common.messages import Phase
from services.operator.report.model import Facts

IN_AIR, AT_THE_PART, IN_CONTACT = 0.25, 0.6, 2.2  # weight of one second of each in the film
CONTACT_N = 1.0
STEP_S = 0.01
LOOKING_S, END_S = 1.2, 1.6  # seconds of film for the pictures that vision saw, and for the last frame


@dataclass(frozen=True, slots=True)
class FrameTime:
    """One frame: the cell's time that it shows, s since the command, and whether the cameras take pictures then."""

    time_s: float
    looking: bool = False


def frame_times(facts: Facts, seconds: float, fps: float) -> list[FrameTime]:
    """About seconds times fps frames. They begin when the sensor is calibrated; ways without a force pass quickly."""
    start_s, end_s = facts.calibrated_s, facts.end_s
    times = np.arange(start_s, max(end_s, start_s + STEP_S), STEP_S)
    worth = np.full(len(times), AT_THE_PART)
    for start, end in facts.forces.free_spans:
        worth[(times >= start) & (times <= end)] = IN_AIR
    trace = facts.forces.main
    if trace is not None:
        pressing = np.interp(times, trace.time_s, np.where(trace.free, 0.0, trace.force_n)) > CONTACT_N
        worth[pressing] = IN_CONTACT
    # show a touch from before it begins until after it ends
    worth = np.convolve(np.pad(worth, 15, mode="edge"), np.ones(31) / 31.0, mode="valid")
    looking = [] if facts.left is None else _looks_at(facts)
    still_frames = len(looking) * round(LOOKING_S * fps) + round(END_S * fps)
    moving = max(2, round(seconds * fps) - still_frames)
    shares = np.concatenate([[0.0], np.cumsum((worth[:-1] + worth[1:]) / 2.0)])
    shown = np.interp(np.linspace(0.0, shares[-1], moving), shares, times)
    frames = [FrameTime(float(time_s)) for time_s in shown]
    for at_s in reversed(looking):
        index = int(np.searchsorted(shown, at_s))
        frames[index:index] = [FrameTime(at_s, looking=True)] * round(LOOKING_S * fps)
    return frames + [FrameTime(end_s)] * round(END_S * fps)


def _looks_at(facts: Facts) -> list[float]:
    """Each time at which vision looked."""
    looks = [span.start_s for span in facts.spans if span.message.phase is Phase.LOCATING]
    return looks[:1]
