"""The lease of the arm as a `with` block: taken at its start, kept by beats, named in every motion, given back."""

from __future__ import annotations

from contextlib import suppress
from typing import TypeVar

from crosspih_common.bus import Bus
from crosspih_common.errors import CrosspihError
from crosspih_common.holding.pulse import Pulse, pulse_of
from crosspih_common.keys import Command
from crosspih_common.messages import Message
from crosspih_common.messages.motion import Held

RequestT = TypeVar("RequestT", bound=Message)
ReplyT = TypeVar("ReplyT", bound=Message)


class ArmLease:
    """The arm, held for one purpose. Taking raises CommandRefused `held`, which names the holder, NoService, or
    CommandTimeout."""

    def __init__(self, bus: Bus, pulse: Pulse, purpose: str) -> None:
        self._bus, self._pulse, self._purpose = bus, pulse, purpose
        self._lease = ""

    def __enter__(self) -> ArmLease:
        self.take()
        return self

    def __exit__(self, *exc: object) -> None:
        self.give()

    def take(self) -> None:
        """Take it; also anew, after the arm has let go of a holder whose beats it missed."""
        self._lease = self._pulse.take(self._purpose).lease

    def give(self) -> None:
        """Give it back; whoever cannot do so any more has lost it already."""
        with suppress(CrosspihError):
            self._pulse.give()
        self._lease = ""

    def named(self, request: RequestT) -> RequestT:
        """The request with the lease in it, where it is one that needs it."""
        return request.model_copy(update={"lease": self._lease}) if isinstance(request, Held) else request

    def ask(
        self, command: Command[RequestT, ReplyT], request: RequestT, deadline_s: float, server_wait_s: float = 0.0
    ) -> ReplyT:
        """Ask as the holder. Raises as `Bus.call`; CommandRefused `no_lease` when the arm is held no longer.

        An arm that is away is not waited for: one that is started again knows this lease no more.
        """
        return self._bus.call(command, self.named(request), deadline_s, server_wait_s)


def hold_arm(bus: Bus, purpose: str) -> ArmLease:
    """The arm, to be held for the length of a `with` block. Raises as ArmLease."""
    return ArmLease(bus, pulse_of(bus), purpose)
