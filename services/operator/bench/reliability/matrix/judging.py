"""The observation of a case, in words, and its judgement. Pure."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from services.operator.bench.reliability.matrix.plan import OPERATOR, RECORDER, MatrixCase, ProcessEnding

RESULT_S = 300.0  # the latest time for a named result, wall time
HEALTHY_S = 120.0
SILENT_S = 0.5  # a longer gap than a recorder's flush, without a warning, is a silent loss


class TapeFigures(BaseModel):
    """The content of the recording: `gap_s` is the longest wall time in which nothing at all was recorded, `missing`
    how many samples never came, without those that a stream drops now and then.
    """

    model_config = ConfigDict(frozen=True)

    parts: int
    gap_s: float
    missing: int
    finished: bool
    warnings: tuple[str, ...] = ()


class MatrixObservation(BaseModel):
    """One case, times in s of the wall clock from the signal.

    `result_s` is when the operator's command had printed its result or, where the operator itself was ended for good,
    when the planner was done. `healthy_s` is when the launcher had the process healthy again and its liveliness token
    was there. `tip_before_m` is how far the peg's tip is before the hole's face at the end, negative in the hole.
    """

    model_config = ConfigDict(frozen=True)

    signalled: bool
    result_s: float | None = None
    inserted: bool = False
    failure: str | None = None
    detail: str = ""
    backed_off: bool = False
    status: int | None = None
    healthy_s: float | None = None
    tape: TapeFigures | None = None
    tip_before_m: float | None = None


def outcome(case: MatrixCase, seen: MatrixObservation) -> str:
    """How it ended."""
    if not seen.signalled:
        return "never got there"
    if seen.result_s is None:
        return "no result"
    if gone(case):
        return "the planner went on: " + ("inserted" if seen.inserted else seen.detail)
    if seen.inserted:
        return "inserted"
    if seen.failure is None:
        return f"status {seen.status}: {seen.detail}"
    return seen.failure + (", peg out" if seen.backed_off else "")


def gone(case: MatrixCase) -> bool:
    """Whether no process is left to get a result."""
    return case.victim == OPERATOR and case.ending is not ProcessEnding.STOP


def lost(seen: MatrixObservation) -> str:
    """The losses in the recording."""
    tape = seen.tape
    if tape is None:
        return "no recording" if seen.signalled else ""
    said = []
    if tape.parts > 1:
        said.append(f"{tape.parts} parts")
    if tape.gap_s > SILENT_S:
        said.append(f"{tape.gap_s:.1f} s")
    if tape.missing:
        said.append(f"{tape.missing} samples")
    if not tape.finished:
        said.append("no end")
    return ", ".join(said) or "nothing"


def _misses(case: MatrixCase, tape: TapeFigures) -> bool:
    """Sequence numbers show which samples never came. A time without any sample is a loss only if the recorder was
    away: others' samples may come late on a busy machine, but complete.
    """
    return tape.missing > 0 or (case.victim == RECORDER and tape.gap_s > SILENT_S)


def complaints(case: MatrixCase, seen: MatrixObservation) -> list[str]:
    """Everything that is wrong; empty when all holds."""
    if not seen.signalled:
        return [f"the assembly never came to where {case.victim} was to be ended: {seen.detail}"]
    found = []
    if seen.result_s is None or seen.result_s > RESULT_S:
        found.append("nobody was told a result")
    elif not gone(case) and not seen.inserted and seen.failure is None:
        found.append(f"the result has no name: {seen.detail}")
    if case.victim != OPERATOR and (seen.healthy_s is None or seen.healthy_s > HEALTHY_S):
        found.append(f"{case.victim} was not healthy again")
    if not seen.inserted and seen.tip_before_m is not None and seen.tip_before_m < 0.0:
        found.append(f"the peg's tip is still {-seen.tip_before_m * 1e3:.0f} mm in the hole")
    tape = seen.tape
    if tape is None:
        found.append("there is no recording")
    elif _misses(case, tape) and not tape.warnings and tape.parts == 1 and not gone(case):
        found.append("the recording misses something, and nothing says so")
    return found
