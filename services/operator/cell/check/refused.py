"""The results of commands that should be refused, and of a stop. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from crosspih_common.messages import MotionOutcome, StopReason
from services.operator.cli.rows import Row, ok, wrong

STOP_LIMIT_S = 0.2


@dataclass(frozen=True, slots=True)
class CommandEnd:
    """A command's end: the code and text of a refusal, or a description of what was done."""

    code: str | None
    text: str = ""


def check_refused(name: str, answer: CommandEnd, expected: tuple[str, ...], mend: str) -> Row:
    """A command that must be refused before anything moves, with one of the codes."""
    if answer.code is None:
        return wrong(name, f"it was carried out: {answer.text}", mend)
    if answer.code not in expected:
        return wrong(
            name,
            f"refused with code {answer.code}: {answer.text[:160]}",
            f"{mend}; the code is {' or '.join(expected)} (docs/wire.md)",
        )
    return ok(name, f"refused: {answer.code}")


def check_held_still(outcome: MotionOutcome) -> Row:
    """A dwell in free air that was ended before its time."""
    return wrong(
        "holding still",
        f"ended by {outcome.stop_reason.value}: {outcome.detail}",
        "the arm broke off while nothing moved: mend the sensor's range or units above, or what the detail names",
    )


def check_stop(outcome: MotionOutcome, heard: bool, latency_s: float, realtime: bool) -> Row:
    """A stop sent during a slow move. `heard`: the reply said that something moved.

    Where the cell's clock does not run in real time, only whether it stopped counts.
    """
    name = "stop"
    mend = "hear arm/stop in every state, on a lane of its own, and end what moves within 0.2 s of the cell's clock"
    if outcome.stop_reason is not StopReason.STOPPED:
        return wrong(name, f"the move went on to its end: {outcome.stop_reason.value}", mend)
    if not heard:
        return wrong(name, "it stopped, but the reply said that nothing moved", mend)
    if realtime and latency_s > STOP_LIMIT_S:
        return wrong(name, f"stopped {latency_s:.3f} s after the stop was sent", mend)
    return ok(name, f"stopped within {max(latency_s, 0.0):.3f} s" if realtime else "stopped; not in real time")
