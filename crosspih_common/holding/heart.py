"""Takes a lease and beats for it from a thread of this process."""

from __future__ import annotations

import threading
from collections.abc import Callable

from crosspih_common.bus import Bus
from crosspih_common.keys import LEASE_BEAT, LEASE_GIVE, LEASE_TAKE
from crosspih_common.messages import GiveLease, LeaseBeat, LeaseGranted, TakeLease

ASK_DEADLINE_S = 8.0
SERVER_WAIT_S = 4.0  # how long to wait for an arm that is just being started


class Heart:
    """Implements Pulse. It calls `owner_lives` before each beat and sends none while that is False."""

    def __init__(self, bus: Bus, owner_lives: Callable[[], bool] = lambda: True) -> None:
        self._bus, self._owner_lives = bus, owner_lives
        self._beats = bus.publisher(LEASE_BEAT)
        self._quiet = threading.Event()
        self._thread: threading.Thread | None = None
        self._lease = ""

    def take(self, purpose: str) -> LeaseGranted:
        """See Pulse. A lease that is still held is given back first."""
        self.give()
        request = TakeLease(holder=self._bus.service, purpose=purpose)
        granted = self._bus.call(LEASE_TAKE, request, ASK_DEADLINE_S, SERVER_WAIT_S)
        self._lease, self._quiet = granted.lease, threading.Event()
        self._thread = threading.Thread(target=self._beat, args=(granted, self._quiet), name="beats", daemon=True)
        self._thread.start()
        return granted

    def _beat(self, granted: LeaseGranted, quiet: threading.Event) -> None:
        beat = LeaseBeat(lease=granted.lease, holder=granted.holder)
        while True:
            if self._owner_lives():
                self._beats.publish(beat)
            if quiet.wait(granted.beat_s):
                return

    def give(self) -> bool:
        """See Pulse."""
        lease, self._lease = self._lease, ""
        try:
            return bool(lease) and self._bus.call(LEASE_GIVE, GiveLease(lease=lease), ASK_DEADLINE_S, 0.0).was_held
        finally:
            self._rest()

    def _rest(self) -> None:
        self._quiet.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def close(self) -> None:
        """See Pulse."""
        self._rest()
