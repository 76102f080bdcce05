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
        """Take the lease; also again, after the arm released it because beats were missing."""
        self._lease = self._pulse.take(self._purpose).lease

    def give(self) -> None:
        """Give the lease back. No error if that fails: the lease is then lost already."""
        with suppress(CrosspihError):
            self._pulse.give()
        self._lease = ""

    def named(self, request: RequestT) -> RequestT:
        """The request with the lease filled in, if it is one that needs a lease."""
        return request.model_copy(update={"lease": self._lease}) if isinstance(request, Held) else request

    def ask(
        self, command: Command[RequestT, ReplyT], request: RequestT, deadline_s: float, server_wait_s: float = 0.0
    ) -> ReplyT:
        """Send a command as the holder. Raises as `Bus.call`; CommandRefused `no_lease` when the lease is lost.

        It does not wait for an arm service that is away: a restarted one does not know this lease.
        """
        return self._bus.call(command, self.named(request), deadline_s, server_wait_s)


def hold_arm(bus: Bus, purpose: str) -> ArmLease:
    """The arm, to be held for the length of a `with` block. Raises as ArmLease."""
    return ArmLease(bus, pulse_of(bus), purpose)
