"""What the assembly needs of the world, so that it can be run without a bus."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from crosspih_common.keys import Command
from crosspih_common.messages import AssemblyPhase, Failure, FtCalibration, Message, MotionOutcome, Touch

RequestT = TypeVar("RequestT", bound=Message)
ReplyT = TypeVar("ReplyT", bound=Message)


class AssemblyFailed(Exception):
    """The assembly cannot go on; the peg must now be backed off."""

    def __init__(self, failure: Failure, detail: str, lost: str = "") -> None:
        super().__init__(f"{failure.value}: {detail}")
        self.failure, self.detail = failure, detail
        self.lost = lost  # the service, of SERVICE_LOST


class Ports(Protocol):
    """Ask a service, tell people."""

    def look(self, dwell: Callable[[], MotionOutcome]) -> MotionOutcome:
        """Have the arm hold still, and see that the cell's streams tell of it: before anything moves.

        Raises CommandRefused `cell_unfit` when they do not, and as `ask`.
        """

    def ask(self, command: Command[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """Ask and wait.

        Raises CommandRefused when the service says no, AssemblyFailed(SERVICE_LOST) when it vanished and did not come
        back in time, AssemblyFailed(ARM_STOPPED) when the arm let go of this holder, and AssemblyFailed(ABORTED) when
        somebody ended the assembly.
        """

    def ft_calibration(self) -> FtCalibration | None:
        """The sensor's calibration as last published; None before any was heard of."""

    def publish_phase(self, phase: AssemblyPhase) -> None:
        """Publish a step."""

    def publish_touch(self, touch: Touch) -> None:
        """Publish a touch."""

    def publish_event(self, code: str, text: str) -> None:
        """Tell people something that is no step of the assembly."""

    def report_defect(self, error: Exception) -> None:
        """Log an error of the program itself with its trace, and tell people."""

    def ignore_abort(self) -> None:
        """From here on finish what was begun: the peg is being backed off."""
