"""Where an arm stands, told to the simulated cameras of another process (following.py)."""

from __future__ import annotations

import contextlib
import socket
import struct

from crosspih_common.geometry.pose import Array

EVERY = 10  # cycles from one telling to the next


class JointsTeller:
    """Tells such cameras where the joints stand; nobody need listen."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._address = host, int(port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._cycles = 0

    def cycle(self, joints_rad: Array) -> None:
        """A cycle of the arm, its joints (n,)."""
        self._cycles += 1
        if self._cycles % EVERY == 1:
            with contextlib.suppress(OSError):
                self._socket.sendto(struct.pack(f"<{len(joints_rad)}d", *joints_rad), self._address)

    def close(self) -> None:
        """Tell no more."""
        self._socket.close()
