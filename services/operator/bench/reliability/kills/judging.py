"""The observation when a service was ended, and its judgement. Pure."""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Failure
from services.operator.bench.reliability.kills.plan import COMPUTING, KillCase, ServiceEnding

LOOK_BACK_S = 0.02
AT_END_RAD = 2e-5
STOP_S = 0.2  # by the cell's clock, from the moment in which the holder counts as gone
NAMED_S = 1.0  # by the wall clock
ALLOWED = 1.1  # times the cap


class Limits(BaseModel):
    """The limits that the cell's file promises."""

    model_config = ConfigDict(frozen=True)

    force_cap_n: float
    holder_timeout_s: float


class Observed(BaseModel):
    """One case. `stop_s` and `beats_s` are by the cell's clock, other `_s` by the wall clock, all from the signal.

    `beats_s` is when the last beat of the holder was received: a killed process takes a while to be gone. Both are
    given for the planner alone: losing another service does not stop a motion under way. `tip_before_m` is how far the
    peg's tip is before the hole's face at the end, negative in the hole; None where the cell was started again.
    """

    model_config = ConfigDict(frozen=True)

    signalled: bool
    moving: bool = False
    force_n: float = 0.0
    stop_s: float | None = None
    beats_s: float | None = None
    stop_reason: str = ""
    named_s: float | None = None
    named_by: str = ""
    inserted: bool = False
    failure: Failure | None = None
    detail: str = ""
    asker_told: str = ""
    backed_off: bool = False
    done_reported: bool = False
    ended_s: float | None = None
    peak_n: float = 0.0
    tip_before_m: float | None = None


def stopped_after_s(stamps_ns: Array, joints_rad: Array, signal_ns: int) -> float | None:
    """When the joints (k, n), with stamps (k,), stopped moving on in the direction that they had at the signal, s after
    it.

    They may stand still there or turn back. None where they did not move at the signal.
    """
    seconds = (np.asarray(stamps_ns, dtype=float) - signal_ns) * 1e-9
    before = joints_rad[(seconds >= -LOOK_BACK_S) & (seconds <= 0.0)]
    after = seconds > 0.0
    if len(before) < 2 or not after.any():
        return None
    way = before[-1] - before[0]
    length = float(np.linalg.norm(way))
    if length < AT_END_RAD:
        return None
    along = (joints_rad[after] - before[-1]) @ (way / length)
    farthest = max(float(along.max()), 0.0)
    if farthest <= AT_END_RAD:
        return 0.0
    return float(seconds[after][int(np.argmax(along >= farthest - AT_END_RAD))])


def complaints(case: KillCase, seen: Observed, limits: Limits) -> list[str]:
    """Everything that is wrong; empty when all limits hold."""
    if not seen.signalled:
        return [f"the assembly never came to where {case.service} was to be ended: {seen.detail or seen.asker_told}"]
    found = []
    if seen.peak_n > ALLOWED * limits.force_cap_n:
        found.append(f"pressed with {seen.peak_n:.0f} N, the cap is {limits.force_cap_n:g} N")
    if seen.named_s is None:
        found.append("nobody named the loss")
    elif seen.named_s > NAMED_S:
        found.append(f"named after {seen.named_s:.2f} s, want {NAMED_S:g} s")
    if seen.ended_s is None:
        return [*found, "the assembly did not end"]
    if case.service == "planning":
        return found + _planner_gone(case, seen, limits)
    if case.service == "recorder":
        return found + ([] if seen.inserted else [f"the assembly did not go on: {seen.failure}"])
    if not seen.inserted:
        found += _orderly_end(seen, needs_peg_out=case.service in COMPUTING)
    elif case.service == "hardware":
        found.append("inserted without hardware")
    return found


def _planner_gone(case: KillCase, seen: Observed, limits: Limits) -> list[str]:
    found = []
    allowed_s = limits.holder_timeout_s + STOP_S
    went_on_s = None if seen.stop_s is None else seen.stop_s - (seen.beats_s or 0.0)
    if went_on_s is not None and went_on_s > allowed_s:
        found.append(f"the arm went on for {went_on_s:.2f} s without a beat of its holder, want {allowed_s:g} s")
    if case.ending is ServiceEnding.KILL:
        if not seen.asker_told:
            found.append("whoever asked for the assembly was not told")
    elif not seen.inserted and not seen.asker_told:
        # it came back before its link was cut, and finds that the arm has dropped it
        found += _orderly_end(seen, needs_peg_out=True, want=(Failure.ARM_STOPPED, Failure.SERVICE_LOST))
    return found


def _orderly_end(seen: Observed, needs_peg_out: bool, want: tuple[Failure, ...] = (Failure.SERVICE_LOST,)) -> list[str]:
    found = []
    if seen.failure not in want:
        said = seen.failure.value if seen.failure is not None else seen.asker_told
        found.append(f"ended as {said}, want {' or '.join(one.value for one in want)}")
    if needs_peg_out and not seen.backed_off:
        found.append("the peg was not backed off")
    if needs_peg_out and seen.tip_before_m is not None and seen.tip_before_m < 0.0:
        found.append(f"the peg's tip is still {-seen.tip_before_m * 1e3:.0f} mm in the hole")
    if not seen.done_reported:
        found.append("no DONE was told")
    return found
