"""What a peer of a force/torque sensor feels: fed by UDP, so that any process on this machine can be its world.

A datagram has 48 bytes: six little-endian doubles, Fx Fy Fz in N, Tx Ty Tz in Nm. The last one stands until the next;
of several in one datagram the last. Nothing is answered.
"""

from __future__ import annotations

import contextlib
import socket
import struct

WRENCH = struct.Struct("<6d")
Wrench = tuple[float, ...]


class Feed:
    """The socket that is fed, and what it was fed last. `take` after it is readable."""

    def __init__(self, host: str, port: int, wrench: Wrench = (0.0,) * 6) -> None:
        self.socket = udp(host, port)
        self.port: int = self.socket.getsockname()[1]
        self.wrench = wrench

    def take(self) -> None:
        """Whatever lies in the socket."""
        with contextlib.suppress(BlockingIOError):
            while True:
                data = self.socket.recv(65536)
                if data and len(data) % WRENCH.size == 0:
                    self.wrench = WRENCH.unpack(data[-WRENCH.size :])

    def close(self) -> None:
        """Be fed no more."""
        self.socket.close()


def udp(host: str, port: int) -> socket.socket:
    """A socket that is bound and does not wait."""
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind((host, port))
    one.setblocking(False)
    return one
