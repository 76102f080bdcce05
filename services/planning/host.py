"""What an assembly over the bus, and a look at what a predecessor left, need of the service that they run in."""

from __future__ import annotations

import threading
from contextlib import AbstractContextManager
from typing import Protocol

from crosspih_common.bus import Bus
from crosspih_common.bus.latest import Latest
from crosspih_common.bus.publisher import Publisher
from crosspih_common.holding import ArmLease
from crosspih_common.messages import AssemblyPhase, CellClock, FtCalibration, LeaseState, Touch
from crosspih_common.service import ServiceContext
from services.planning.missed import MissedServices
from services.planning.pausing import Pause


class AssemblyHost(Protocol):
    """Of the service: its bus, what it heard last, what it publishes, and how it is told to end."""

    bus: Bus
    context: ServiceContext
    abort: threading.Event
    pause: Pause
    closing: threading.Event
    missed: MissedServices
    calibration: Latest[FtCalibration]
    clock: Latest[CellClock]
    phases: Publisher[AssemblyPhase]
    touches: Publisher[Touch]


class ArmHolder(AssemblyHost, Protocol):
    """That, and who holds the arm."""

    has_held: bool
    lease_state: Latest[LeaseState]

    def holding(self, purpose: str) -> AbstractContextManager[ArmLease]:
        """The arm held for a block. Raises CommandRefused."""
