"""Raw data transfer (RDT): requests of 8 bytes, records of 36, all big-endian, by UDP.

Layout by ATI's manuals 9620-05-NET FT and 9610-05-Ethernet Axia, section "RDT": a request is header 0x1234, command,
count (0: without end); a record is the sequence number within the stream, from 1, the sensor's own sequence number,
which goes on at its internal rate since it was powered up, the status word, and six counts. Both roll over at 2**32.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HEADER, STOP, START_REALTIME, SET_BIAS = 0x1234, 0x0000, 0x0002, 0x0042
REQUEST = struct.Struct(">HHI")
RECORD = np.dtype([("rdt", ">u4"), ("ft", ">u4"), ("status", ">u4"), ("counts", ">i4", (6,))])
ROLL = 1 << 32
BUFFER = 4 << 20  # bytes that may wait in the kernel; how many it grants is its own affair
# Linux tells with each datagram when it came in, whatever this process does then; others are stamped when read
SO_TIMESTAMPNS = 35 if sys.platform == "linux" else None
_TIMESPEC = struct.Struct("@qq")
_ROOM = socket.CMSG_SPACE(_TIMESPEC.size) if SO_TIMESTAMPNS is not None else 0


@dataclass(frozen=True, slots=True, eq=False)
class Records:
    """What lay in the socket: records (n,) of `RECORD` in the order in which they came, and when, `monotonic_ns`."""

    records: NDArray[np.void]
    arrived_ns: NDArray[np.int64]
    malformed: int


class RdtSocket:
    """The UDP side of one box. Nothing here waits, but for opening: the name may have to be looked up."""

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            if SO_TIMESTAMPNS is not None:
                self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            self._socket.connect((host, port))
            self._socket.setblocking(False)
        except BaseException:
            self._socket.close()
            raise

    def send(self, command: int) -> None:
        """A request; a box that is away is no error."""
        with contextlib.suppress(OSError):
            self._socket.send(REQUEST.pack(HEADER, command, 0))

    def receive(self, most: int = 4096) -> Records:
        """All that has come, `most` datagrams at the most."""
        pieces: list[bytes] = []
        arrived: list[int] = []
        malformed = 0
        behind_ns = _monotonic_behind_ns()
        for _ in range(most):
            try:
                data, ancillary, _, _ = self._socket.recvmsg(2048, _ROOM)
            except BlockingIOError:
                break
            except OSError:  # such as refused: the box said that nobody listens there
                continue
            if not data or len(data) % RECORD.itemsize:
                malformed += 1
                continue
            if ancillary:
                seconds, nanoseconds = _TIMESPEC.unpack(ancillary[0][2][: _TIMESPEC.size])
                stamp_ns = seconds * 1_000_000_000 + nanoseconds - behind_ns
            else:
                stamp_ns = time.monotonic_ns()
            pieces.append(data)
            arrived += [stamp_ns] * (len(data) // RECORD.itemsize)
        return Records(np.frombuffer(b"".join(pieces), RECORD), np.array(arrived, dtype=np.int64), malformed)

    def close(self) -> None:
        """Stop the stream and let go."""
        self.send(STOP)
        self._socket.close()


def _monotonic_behind_ns() -> int:
    """By how much `monotonic_ns` is behind the wall's clock, which the kernel stamps with: asked without a break
    between."""
    best_ns, behind_ns = ROLL, 0
    for _ in range(3):
        before_ns = time.monotonic_ns()
        wall_ns = time.time_ns()
        took_ns = time.monotonic_ns() - before_ns
        if took_ns < best_ns:
            best_ns, behind_ns = took_ns, wall_ns - before_ns - took_ns // 2
        if took_ns < 3000:
            break
    return behind_ns
