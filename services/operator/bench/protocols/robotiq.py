"""`python -m services.operator.bench.protocols.robotiq`: a Robotiq FT 300 on a Modbus TCP port or a serial line,
without the sensor.

Modbus is pymodbus' own server; registers and data stream are those of Robotiq's manual of the FT 300, section "Serial
communication". `--tcp PORT` listens there; `--serial PATH` makes a serial line (a pseudo-terminal, Linux and macOS)
with that name. Its wrench is fed to it (feed.py); before that it is `--wrench`. When it serves it prints
`ready feed PORT`.

On standard input it takes one command a line: `off S` (dead for S seconds, then no stream until asked),
`garble N` (one wrong byte in each of the next N packets of the stream), `slow S` (each answer takes S seconds), `quit`.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import select
import sys
import threading
import time
import tty
from collections.abc import Sequence
from pathlib import Path

from pymodbus import FramerType
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from services.operator.bench.protocols.feed import Feed

WRENCH_AT, SELECT_OUTPUT, STREAM = 180, 410, 0x0200
PER_UNIT = (100, 100, 100, 1000, 1000, 1000)
STREAM_HZ = 100.0
TRANSMIT_S = 16 * 10 / 19200  # of a packet at 19200 baud, eight bits and two more each
JAM, JAM_BYTES = 0xFF, 20


def crc16(data: bytes) -> int:
    """Modbus' own, of a packet's first 14 bytes."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


class Ft300:
    """The registers and the stream of one sensor."""

    def __init__(self, feed: Feed, device_id: int) -> None:
        self.feed = feed
        self.streaming = threading.Event()
        self.quit = threading.Event()
        self.off_until_s = 0.0
        self.garble = 0
        self.slow_s = 0.0
        texts = [SimData(500, values=[0x5331, 0x3201, 0x0105], datatype=DataType.REGISTERS, readonly=True)]
        texts += [SimData(510, values=[0x5359, 0x4E00, 0, 4711, 2026], datatype=DataType.REGISTERS, readonly=True)]
        self.device = SimDevice(
            id=device_id,
            simdata=[
                SimData(WRENCH_AT, values=[0] * 13, datatype=DataType.REGISTERS),
                SimData(SELECT_OUTPUT, values=0, datatype=DataType.REGISTERS),
                *texts,
            ],
            action=self._accessed,
        )

    def numbers(self) -> list[int]:
        """Six registers: the wrench in hundredths of N and thousandths of Nm, 16 bits."""
        counts = (round(one * per) for one, per in zip(self.feed.wrench, PER_UNIT, strict=True))
        return [max(-32768, min(32767, count)) & 0xFFFF for count in counts]

    def packet(self) -> bytes:
        """One of the stream."""
        data = b"\x20\x4e" + b"".join(number.to_bytes(2, "little") for number in self.numbers())
        whole = bytearray(data + crc16(data).to_bytes(2, "little"))
        if self.garble > 0:
            self.garble -= 1
            whole[5] ^= 0x40
        return bytes(whole)

    async def _accessed(
        self, function: int, start: int, address: int, count: int, now: list[int], written: Sequence[int] | None
    ) -> ExcCodes | None:
        if time.monotonic() < self.off_until_s:
            return ExcCodes.DEVICE_FAILURE
        await asyncio.sleep(self.slow_s)
        if written is None:
            now[WRENCH_AT - start : WRENCH_AT - start + 6] = self.numbers()
        elif address == SELECT_OUTPUT and list(written) == [STREAM]:
            self.streaming.set()
        return None

    def command(self, line: str) -> None:
        """One of those in the module's docstring. Raises ValueError, IndexError on others."""
        word, *rest = line.split()
        if word == "off":
            self.off_until_s = time.monotonic() + float(rest[0])
            self.streaming.clear()
        elif word == "slow":
            self.slow_s = float(rest[0])
        elif word == "garble":
            self.garble = int(rest[0])
        elif word == "quit":
            self.quit.set()
        else:
            raise ValueError(f"no command {word!r}")


class SerialLine:
    """A serial line with a name: input goes to the Modbus server, or to the stream, which it stops."""

    def __init__(self, sensor: Ft300, name: Path) -> None:
        self._sensor, self._name = sensor, name
        self._outside, self._outside_end = os.openpty()
        self._inside, self._inside_end = os.openpty()
        for end in (self._outside_end, self._inside_end):
            tty.setraw(end)
        self.server_port = os.ttyname(self._inside_end)
        name.unlink(missing_ok=True)
        name.symlink_to(os.ttyname(self._outside_end))

    def run(self) -> None:
        """Transfer bytes in both directions until `quit`."""
        due_s, jam = 0.0, 0
        sensor = self._sensor
        while not sensor.quit.is_set():
            streaming = sensor.streaming.is_set()
            wait_s = max(0.0, due_s + TRANSMIT_S - time.monotonic()) if streaming and due_s else 0.02
            feed = sensor.feed.socket.fileno()
            ready, _, _ = select.select([self._outside, self._inside, feed], [], [], min(wait_s, 0.02))
            if feed in ready:
                sensor.feed.take()
            if self._inside in ready:
                os.write(self._outside, os.read(self._inside, 4096))
            if self._outside in ready:
                data = os.read(self._outside, 4096)
                if time.monotonic() < sensor.off_until_s:
                    continue
                jam = jam + data.count(JAM) if data.strip(b"\xff") == b"" else 0
                if streaming and jam >= JAM_BYTES:
                    sensor.streaming.clear()
                elif not streaming and not jam:
                    os.write(self._inside, data)
            now_s = time.monotonic()
            if not sensor.streaming.is_set():
                due_s = 0.0
            elif not due_s:
                due_s = now_s + 0.005
            elif now_s >= due_s + TRANSMIT_S:
                os.write(self._outside, sensor.packet())
                due_s += 1.0 / STREAM_HZ

    def close(self) -> None:
        """Remove the line, like an adapter that is unplugged."""
        self._name.unlink(missing_ok=True)
        for end in (self._outside, self._inside, self._outside_end, self._inside_end):
            with contextlib.suppress(OSError):
                os.close(end)


async def _serve(sensor: Ft300, tcp: int | None, line: SerialLine | None) -> None:
    server: ModbusTcpServer | ModbusSerialServer
    if line is not None:
        server = ModbusSerialServer(sensor.device, framer=FramerType.RTU, port=line.server_port, baudrate=19200)
    else:
        server = ModbusTcpServer(sensor.device, address=("127.0.0.1", tcp or 0))
    await server.serve_forever(background=True)
    print(f"ready feed {sensor.feed.port}", flush=True)
    while not sensor.quit.is_set():
        await asyncio.sleep(0.02)
        if line is None:
            sensor.feed.take()
    await server.shutdown()  # type: ignore[no-untyped-call]


def main() -> None:
    """Serve until `quit`, or until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--tcp", type=int, metavar="PORT")
    where.add_argument("--serial", type=Path, metavar="PATH")
    parser.add_argument("--device-id", type=int, default=9)
    parser.add_argument("--feed-port", type=int, default=49161)
    parser.add_argument("--wrench", type=float, nargs=6, default=(0.0,) * 6, help="felt until it is fed, N and Nm")
    parser.add_argument("--stay", action="store_true", help="serve on when standard input ends, until it is ended")
    arguments = parser.parse_args()
    sensor = Ft300(Feed("127.0.0.1", arguments.feed_port, tuple(arguments.wrench)), arguments.device_id)

    def heed() -> None:
        for line in sys.stdin:
            try:
                if line.strip():
                    sensor.command(line)
            except (ValueError, IndexError) as error:
                print(f"not understood: {line.strip()} ({error})", flush=True)
        if not arguments.stay:
            sensor.quit.set()

    threading.Thread(target=heed, daemon=True).start()
    line = SerialLine(sensor, arguments.serial) if arguments.serial is not None else None
    if line is not None:
        threading.Thread(target=line.run, daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_serve(sensor, arguments.tcp, line))
    if line is not None:
        line.close()
    sys.stdout.flush()
    os._exit(0)  # a thread may still wait for standard input


if __name__ == "__main__":
    main()
