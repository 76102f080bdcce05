"""The ports of the assembly to the outside, so that it can run without a bus."""

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
        """Before any motion: let the arm dwell, and check that the cell's streams have samples of it.

        Raises CommandRefused `cell_unfit` if they have none, and as `ask`.
        """

    def ask(self, command: Command[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """Ask and wait.

        Raises CommandRefused when the service refuses, AssemblyFailed(SERVICE_LOST) when it is lost and not back in
        time, AssemblyFailed(ARM_STOPPED) when the arm released this holder, and AssemblyFailed(ABORTED) when somebody
        aborted the assembly.
        """

    def ft_calibration(self) -> FtCalibration | None:
        """The sensor's calibration as last published; None before the first."""

    def publish_phase(self, phase: AssemblyPhase) -> None:
        """Publish a step."""

    def publish_touch(self, touch: Touch) -> None:
        """Publish a touch."""

    def publish_event(self, code: str, text: str) -> None:
        """Tell people something that is no step of the assembly."""

    def report_defect(self, error: Exception) -> None:
        """Log an error of the program itself with its trace, and tell people."""

    def ignore_abort(self) -> None:
        """From here on ignore aborts: the peg is being backed off."""
