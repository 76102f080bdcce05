"""The FT 300's registers and the packets of its data stream. Pure; by Robotiq's manual of the FT 300, section "Serial
communication": 19200 baud, 8N1, address 9, forces in 1/100 N, moments in 1/1000 Nm, 16 bits with sign.

A packet: 0x20 0x4e, six numbers low byte first, Modbus' CRC-16 of these 14 bytes low byte first. 0x0200 in register 410
starts the stream, 100 a second; some 50 bytes 0xff stop it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from crosspih_common.geometry.pose import Array

BAUD = 19200
WRENCH_AT, SELECT_OUTPUT, STREAM = 180, 410, 0x0200
FIRMWARE_AT, SERIAL_AT = 500, 510
JAM = b"\xff" * 50
HEAD, PACKET = b"\x20\x4e", 16
STREAM_HZ = 100.0
PACKET_S = PACKET * 10 / BAUD  # to transmit one
RANGE_N, RANGE_NM = 300.0, 30.0
_PER_COUNT = np.array([0.01, 0.01, 0.01, 0.001, 0.001, 0.001])


def wrench_of(registers: Sequence[int]) -> Array:
    """The wrench (6,), N and Nm, of six registers."""
    return np.asarray(np.array(registers, dtype=np.uint16).view(np.int16) * _PER_COUNT)


def identity(firmware: Sequence[int], serial: Sequence[int]) -> str:
    """Of registers 500 to 502 and 510 to 514: such as `S12-1.1.5, serial SYN-4711 of 2026`."""
    low = [part for word in firmware for part in (word >> 8, word & 0xFF)]
    name = "".join(chr(one) for one in low[:3] if 32 <= one < 127)
    letters = "".join(chr(one) for word in serial[:2] for one in (word >> 8, word & 0xFF) if 32 < one < 127)
    version = ".".join(str(one) for one in low[3:])
    return f"{name}-{version}, serial {letters}-{serial[2] << 16 | serial[3]:04d} of {serial[4]}"


def crc16(data: bytes) -> int:
    """Modbus' CRC: polynomial 0xA001 reflected, begun with 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _CRC[(crc ^ byte) & 0xFF]
    return crc


def _crc_of(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
    return byte


_CRC = tuple(_crc_of(byte) for byte in range(256))


@dataclass(slots=True)
class StreamReader:
    """Bytes as they come, in pieces of any size, to packets. `lost` are those that came damaged."""

    lost: int = 0
    _rest: bytes = b""
    _skipped: int = field(default=0)

    def take(self, data: bytes) -> list[tuple[int, Array]]:
        """The wrenches (6,) that are whole now, each with how many packets were lost right before it."""
        found: list[tuple[int, Array]] = []
        rest = self._rest + data
        while True:
            at = rest.find(HEAD)
            if at < 0:  # the last byte may be the first of a head
                keep = 1 if rest.endswith(HEAD[:1]) else 0
                self._skipped += len(rest) - keep
                rest = rest[len(rest) - keep :]
                break
            self._skipped += at
            rest = rest[at:]
            if len(rest) < PACKET:
                break
            if crc16(rest[: PACKET - 2]) != int.from_bytes(rest[PACKET - 2 : PACKET], "little"):
                self._skipped += 1
                rest = rest[1:]
                continue
            lost = round(self._skipped / PACKET)
            self.lost += lost
            found.append((lost, np.frombuffer(rest[2 : PACKET - 2], "<i2") * _PER_COUNT))
            self._skipped = 0
            rest = rest[PACKET:]
        self._rest = rest
        return found
