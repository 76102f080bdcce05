"""`python -m services.planning.again FILE --cell CELL`: runs an assembly's decisions again on the recorded answers, for
`crosspih replay`.

The planner's core talks through ports. Here they answer from the recording: if a request equals the next recorded one
of its command, it gets the recorded answer or refusal. The first request that differs is the first decision that
differs: after it the recording holds no valid answers.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

from crosspih_common.config import CellFile
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import (
    ASSEMBLE,
    DWELL,
    FT_CALIBRATION,
    LEASE_GIVE,
    LEASE_TAKE,
    PHASE,
    REFUSAL,
    STOP,
    TOUCH,
    WALL_CLOCK,
    Command,
    Topic,
    commands,
)
from crosspih_common.messages import (
    Assemble,
    AssemblyPhase,
    AssemblyResult,
    CommandRefusal,
    Failure,
    FtCalibration,
    Message,
    MotionOutcome,
    Touch,
)
from crosspih_common.recording import OVERTAKEN_NS, Recording
from crosspih_common.recording.comparing import FieldDifference, differences
from crosspih_common.recording.rerun import Rerun, run_again
from services.planning.asking import NO_LEASE
from services.planning.assembly import assemble
from services.planning.config import PlanningConfig
from services.planning.ports import AssemblyFailed
from services.planning.result import result_of

RequestT = TypeVar("RequestT", bound=Message)
ReplyT = TypeVar("ReplyT", bound=Message)
# commands of the shell around the core: the lease of the arm, and the wall clock
NO_DECISIONS = (STOP, LEASE_TAKE, LEASE_GIVE, WALL_CLOCK)
ASKED: tuple[Command[Any, Any], ...] = tuple(
    command for command in commands() if "planning" in command.callers and command not in NO_DECISIONS
)
TOPICS: tuple[Topic[Any], ...] = (
    FT_CALIBRATION, PHASE, TOUCH, REFUSAL,
    *(echo for command in (ASSEMBLE, *ASKED) for echo in (command.request_echo, command.reply_echo)),
)  # fmt: skip
DECISIONS, PHASES, TOUCHES, RESULTS = "requests", "phases", "touches", "results"
HOLDER = frozenset({"lease"})  # the recorded lease; a new run has another one
WALL_TIME = frozenset({"thinking_s"})
# failures caused by the bus, which a replay cannot repeat
BY_THE_BUS = (Failure.SERVICE_LOST, Failure.ABORTED, Failure.ARM_STOPPED)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedRequest:
    """One recorded request of the planner: answered, refused, or neither."""

    command: Command[Any, Any]
    request: Message
    wall_ns: int
    reply: Message | None
    refusal: CommandRefusal | None


class Departed(BaseException):
    """The planner sends a request that was not recorded. A BaseException: the assembly must not handle it."""

    def __init__(self, what: str, at_ns: int, rows: Iterable[FieldDifference]) -> None:
        super().__init__(what)
        self.what, self.at_ns, self.rows = what, at_ns, tuple(rows)


class Untold(BaseException):
    """The recording does not hold the outcome of a request."""


def steps_of(recording: Recording, since_ns: int, until_ns: int) -> list[RecordedRequest]:
    """The requests between two times of the recorder's clock, in order."""
    found = []
    for command in ASKED:
        refused = recording.refusals(command)
        for request, reply in recording.answered(command):
            if since_ns - OVERTAKEN_NS <= request.wall_ns <= until_ns + OVERTAKEN_NS:
                why = refused.get(request.value.seq)
                found.append(
                    RecordedRequest(
                        command, request.value, request.wall_ns, None if reply is None else reply.value, why
                    )
                )
    return sorted(found, key=lambda step: (step.request.stamp_ns, step.wall_ns))


class RecordedPorts:
    """Implements Ports with the answers of a recording."""

    def __init__(
        self,
        steps: list[RecordedRequest],
        calibration: FtCalibration | None,
        result: AssemblyResult | None,
        outcome: Rerun,
    ) -> None:
        self._steps = deque(steps)
        self._calibration, self._result, self._outcome = calibration, result, outcome
        self._heed_abort = True
        self.phases: list[AssemblyPhase] = []
        self.touches: list[Touch] = []

    @property
    def left(self) -> RecordedRequest | None:
        """The first recorded request that was not repeated."""
        return self._steps[0] if self._steps else None

    def look(self, dwell: Callable[[], MotionOutcome]) -> MotionOutcome:
        """See Ports. A stream without samples made the arm dwell once more."""
        outcome = dwell()
        while (after := self.left) is not None and after.command is DWELL:
            outcome = dwell()
        return outcome

    def ask(self, command: Command[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """The recorded answer to the same request. Raises Departed, Untold, or the recorded refusal."""
        while True:
            step = self._next(command, request)
            found = differences(step.request, request, HOLDER)
            self._outcome.count(DECISIONS, not found)
            if found:
                raise Departed(command.path, step.request.stamp_ns, found)
            if step.reply is not None:
                answer: Any = step.reply
                return answer  # type: ignore[no-any-return]
            if step.refusal is None:
                raise self._by_the_bus(command)
            told = CommandRefused(step.refusal.refused, step.refusal.text)
            if told.code != NO_LEASE:
                raise told
            if self._heed_abort:
                raise AssemblyFailed(Failure.ARM_STOPPED, str(told))
            # the lease was taken anew, and the request sent once more

    def _next(self, command: Command[RequestT, ReplyT], request: RequestT) -> RecordedRequest:
        """The next recorded request of a command; echoes of two services may have overtaken each other."""
        for index, step in enumerate(self._steps):
            if step.command == command:
                del self._steps[index]
                return step
        self._outcome.count(DECISIONS, False)
        ahead = self.left
        asked = "nothing more was asked" if ahead is None else ahead.command.path
        at_ns = self._outcome.start_ns if ahead is None else ahead.request.stamp_ns
        raise Departed(command.path, at_ns, [FieldDifference("command", asked, command.path, None)])

    def _by_the_bus(self, command: Command[Any, Any]) -> BaseException:
        result = self._result
        if result is not None and result.failure in BY_THE_BUS:
            assert result.failure is not None
            return AssemblyFailed(result.failure, result.failure_detail, command.server)
        return Untold(f"{command.path}: neither an answer nor a refusal is recorded")

    def ft_calibration(self) -> FtCalibration | None:
        """As it was known when the assembly began."""
        return self._calibration

    def publish_phase(self, phase: AssemblyPhase) -> None:
        """Kept, to be compared."""
        self.phases.append(phase)

    def publish_touch(self, touch: Touch) -> None:
        """Kept, to be compared."""
        self.touches.append(touch)

    def publish_event(self, code: str, text: str) -> None:
        """To people."""
        self._outcome.notes.append(f"{code}: {text}")

    def report_defect(self, error: Exception) -> None:
        """To people."""
        self._outcome.notes.append(f"a defect: {type(error).__name__}: {error}")

    def ignore_abort(self) -> None:
        """From here on finish what was begun."""
        self._heed_abort = False


def rerun(recording: Recording, cell: CellFile, from_ns: int, outcome: Rerun) -> None:
    """Run again every assembly of the recording that begins at `from_ns` or later."""
    config = cell.section("planning", PlanningConfig)
    for request, reply in recording.answered(ASSEMBLE):
        if request.value.stamp_ns < from_ns:
            continue
        until_ns = sys.maxsize if reply is None else reply.wall_ns
        steps = steps_of(recording, request.wall_ns, until_ns)
        known = [one for one in recording.sent(FT_CALIBRATION) if one.wall_ns <= request.wall_ns + OVERTAKEN_NS]
        ports = RecordedPorts(
            steps, known[-1].value if known else None, None if reply is None else reply.value, outcome
        )
        _assembly(recording, cell, config, request.value, ports, None if reply is None else reply.value, outcome)


def _assembly(
    recording: Recording, cell: CellFile, config: PlanningConfig, request: Assemble, ports: RecordedPorts,
    result: AssemblyResult | None, outcome: Rerun,
) -> None:  # fmt: skip
    try:
        done = assemble(cell.workcell, config, ports, request)
    except Departed as departed:
        outcome.notes.append(
            f"the first decision that differs: {departed.what} at {outcome.at_s(departed.at_ns):.3f} s; what would "
            "have come of it is not in the recording"
        )
        for row in departed.rows:
            outcome.differ(departed.what, departed.at_ns, row)
        return
    except Untold as untold:
        outcome.notes.append(f"ends here: {untold}")
        return
    except CommandRefused as refusal:
        outcome.notes.append(f"the assembly is refused: {refusal}")
        if result is not None:
            outcome.count(RESULTS, False)
        return
    if (left := ports.left) is not None:
        outcome.count(DECISIONS, False)
        outcome.differ(
            left.command.path, left.request.stamp_ns, FieldDifference("command", left.command.path, "none", None)
        )
    told = [one for one in recording.messages(PHASE) if one.stamp_ns >= request.stamp_ns]
    _in_order(PHASES, PHASE, told, ports.phases, outcome)
    felt = [one for one in recording.messages(TOUCH) if any(one.stamp_ns == now.stamp_ns for now in ports.touches)]
    _in_order(TOUCHES, TOUCH, felt, ports.touches, outcome)
    if result is not None:
        outcome.compare(
            RESULTS, ASSEMBLE.path, result.stamp_ns, result, result_of(request, done, result.thinking_s), WALL_TIME
        )


def _in_order(part: str, topic: Topic[Any], then: list[Any], now: list[Any], outcome: Rerun) -> None:
    for was, will in zip(then, now, strict=False):
        outcome.compare(part, topic.path, was.stamp_ns, was, will)
    for _ in range(abs(len(then) - len(now))):
        outcome.count(part, False)


if __name__ == "__main__":
    sys.exit(run_again(TOPICS, rerun))
