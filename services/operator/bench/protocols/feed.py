"""The wrench on a simulated force/torque sensor: fed by UDP, so that any process on this machine can simulate its cell.

A datagram has 48 bytes: six little-endian doubles, Fx Fy Fz in N, Tx Ty Tz in Nm. The last one holds until the next.
There is no answer.
"""

from __future__ import annotations

import contextlib
import socket
import struct

WRENCH = struct.Struct("<6d")
Wrench = tuple[float, ...]


class Feed:
    """The feed's socket, and its last wrench. Call `take` when it is readable."""

    def __init__(self, host: str, port: int, wrench: Wrench = (0.0,) * 6) -> None:
        self.socket = udp(host, port)
        self.port: int = self.socket.getsockname()[1]
        self.wrench = wrench

    def take(self) -> None:
        """Read everything that waits in the socket."""
        with contextlib.suppress(BlockingIOError):
            while True:
                data = self.socket.recv(65536)
                if data and len(data) % WRENCH.size == 0:
                    self.wrench = WRENCH.unpack(data[-WRENCH.size :])

    def close(self) -> None:
        """Close the socket."""
        self.socket.close()


def udp(host: str, port: int) -> socket.socket:
    """A bound, non-blocking socket."""
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind((host, port))
    one.setblocking(False)
    return one
