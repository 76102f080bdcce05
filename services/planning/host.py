"""The interfaces of the planning service that an assembly, and the check after a crashed predecessor, use."""

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
    """The service as an assembly sees it: its bus, latest messages, publishers, and the abort flag."""

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
    """An AssemblyHost that can also hold the arm."""

    has_held: bool
    lease_state: Latest[LeaseState]

    def holding(self, purpose: str) -> AbstractContextManager[ArmLease]:
        """The arm held for a block. Raises CommandRefused."""
