"""Planning's results as a line for people, and their time limits."""

from __future__ import annotations

from crosspih_common.errors import STOPPING, CommandRefused, CrosspihError, NoService, NotSent
from crosspih_common.messages import AssemblyResult, Failure, WithdrawResult

ASSEMBLY_DEADLINE_S = 900.0
WITHDRAW_DEADLINE_S = 300.0
ABORT_DEADLINE_S = 5.0
Said = tuple[bool, str]


def assembly_outcome(result: AssemblyResult) -> Said:
    """Whether the peg is in, and a line for people."""
    if not result.inserted:
        why = result.failure.value if result.failure is not None else "not inserted"
        return False, f"{why}: {result.failure_detail}" if result.failure_detail else why
    depth_mm, duration_s = result.insertion_depth_m * 1e3, result.motion_s + result.thinking_s
    text = f"inserted, {depth_mm:.1f} mm deep, {duration_s:.1f} s, peak {result.peak_force_n:.1f} N"
    return True, "; ".join([text, *result.warnings])


def error_outcome(error: CrosspihError) -> tuple[str, str]:
    """The name and the text of an assembly without a result: `refused` if planning refused; `no_service` if it was not
    running; `service_lost` if it stopped in between; otherwise the error's own code."""
    if isinstance(error, NotSent):
        return error.code, f"{error}; nothing was begun"
    refused = isinstance(error, CommandRefused)
    if isinstance(error, NoService) or (refused and error.code == STOPPING):
        lost = f"planning, or the link to it, was lost in the middle of the assembly ({error})"
        return Failure.SERVICE_LOST.value, f"{lost}: the peg may be in the hole; `withdraw` takes it out"
    return Failure.REFUSED.value if refused else error.code, str(error)


def withdrawal_outcome(result: WithdrawResult) -> Said:
    """Whether the peg is out, and a line for people."""
    if not result.withdrawn:
        return False, f"{result.failure.value if result.failure else 'not out'}: {result.failure_detail}"
    return True, f"out, {result.distance_m * 1e3:.1f} mm in {result.motion_s:.1f} s, peak {result.peak_force_n:.1f} N"
