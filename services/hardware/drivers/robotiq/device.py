"""The sensor while it runs: a thread reads the line, `read` takes what has come."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException

from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Severity
from services.hardware.device_clock import DeviceClock, onward
from services.hardware.drivers.registry import Tell
from services.hardware.drivers.robotiq.config import RobotiqConfig
from services.hardware.drivers.robotiq.wire import (
    BAUD,
    FIRMWARE_AT,
    JAM,
    PACKET_S,
    RANGE_N,
    RANGE_NM,
    SELECT_OUTPUT,
    SERIAL_AT,
    STREAM,
    STREAM_HZ,
    WRENCH_AT,
    StreamReader,
    identity,
    wrench_of,
)
from services.hardware.protocols import WrenchSamples

SILENT_S = 0.5
TRY_S = 0.5
TELL_S = 2.0
# nobody says how exact its 100 Hz are; USB adapters hand on what came every few milliseconds
STREAM_PPM, ADAPTER_S = 5000.0, 2e-3
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL + 1)  # what goes wrong is told once, by us


class LinkLost(Exception):
    """The sensor does not answer, or no longer; says how."""


@dataclass(slots=True)
class SampleCounts:
    """What became of the samples since the sensor was opened."""

    received: int = 0
    damaged: int = 0  # packets of the stream with a wrong CRC
    reconnections: int = 0


class Link:
    """One connection: Modbus over TCP or a serial line, and on the latter the stream. Raises LinkLost."""

    def __init__(self, config: RobotiqConfig) -> None:
        self._config = config
        self._client: Any
        if config.serial is not None:
            self._client = ModbusSerialClient(config.serial, baudrate=BAUD, timeout=config.timeout_s, retries=0)
        else:
            self._client = ModbusTcpClient(config.host or "", port=config.tcp_port, timeout=config.timeout_s, retries=0)
        if not self._client.connect():
            where = config.serial or f"{config.host}:{config.tcp_port}"
            raise LinkLost(f"{where} cannot be opened")
        if config.serial is not None:  # it may still stream for whoever had it before
            self._line().write(JAM)
            time.sleep(0.1)
            self._line().reset_input_buffer()

    def _line(self) -> Any:
        return self._client.socket

    def identity(self) -> str:
        """What it says of itself; gateways need not know these registers."""
        try:
            return identity(self._registers(FIRMWARE_AT, 3), self._registers(SERIAL_AT, 5))
        except LinkLost:
            return "FT 300"

    def wrench(self) -> Array:
        """What it feels now (6,), by its registers."""
        return wrench_of(self._registers(WRENCH_AT, 6))

    def _registers(self, address: int, count: int) -> list[int]:
        try:
            reply = self._client.read_holding_registers(address, count=count, device_id=self._config.device_id)
        except (ModbusException, OSError) as error:
            raise LinkLost(f"no answer ({error})") from None
        if reply.isError() or len(reply.registers) != count:
            raise LinkLost(f"register {address} is answered with {reply}")
        registers: list[int] = reply.registers
        return registers

    def start_stream(self) -> None:
        """From now on packets come."""
        try:
            reply = self._client.write_registers(SELECT_OUTPUT, [STREAM], device_id=self._config.device_id)
        except (ModbusException, OSError) as error:
            raise LinkLost(f"the stream cannot be started ({error})") from None
        if reply.isError():
            raise LinkLost(f"the stream cannot be started: {reply}")
        self._line().timeout = SILENT_S

    def stream_bytes(self) -> bytes:
        """What has come of the stream, waiting for some."""
        try:
            line = self._line()
            data: bytes = line.read(1)
            return data + line.read(line.in_waiting) if data else data
        except (OSError, TypeError, ValueError) as error:  # pyserial raises any of them when an adapter is pulled
            raise LinkLost(f"the line is gone ({error})") from None

    def close(self) -> None:
        """Stop the stream, if any, and let go."""
        with contextlib.suppress(Exception):
            if self._config.serial is not None:
                self._line().write(JAM)
        with contextlib.suppress(Exception):
            self._client.close()


class Ft300Wrench:
    """Implements WrenchDevice; stamps are `monotonic_ns` of this machine."""

    def __init__(self, config: RobotiqConfig, link: Link, said: str, tell: Tell) -> None:
        self._config, self._said, self._tell = config, said, tell
        self._link: Link | None = link
        self.period_s = 1.0 / (STREAM_HZ if config.streams else config.poll_hz)
        self.clock: DeviceClock | None = None  # of the stream; an answer to a question lies between the two
        self.counts = SampleCounts()
        self._samples: list[tuple[int, Array]] = []
        self._lock = threading.Lock()
        self._last_ns: int | None = None
        self._told: dict[str, float] = {}
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ft300", daemon=True)
        self._thread.start()

    def read(self) -> WrenchSamples:
        """What has come since the last read; never waits."""
        with self._lock:
            got, self._samples = self._samples, []
        if not got:
            return WrenchSamples(np.zeros(0, dtype=np.int64), np.zeros((0, 6)))
        stamps_ns = onward(np.array([stamp for stamp, _ in got], dtype=np.int64), self._last_ns)
        self._last_ns = int(stamps_ns[-1])
        return WrenchSamples(stamps_ns, np.array([wrench for _, wrench in got]))

    # ------------------------------------------------------------------------------------------------------- its thread

    def _run(self) -> None:
        lost = False
        while not self._closing.is_set():
            try:
                if self._link is None:
                    self._link = Link(self._config)
                    self._link.wrench()
                    self._same_as_before(self._link.identity())
                    self.counts.reconnections += 1
                (self._stream if self._config.streams else self._poll)(self._link, self._back if lost else None)
            except LinkLost as error:
                if self._closing.is_set():
                    return
                if not lost:
                    text = f"the FT 300 sensor is lost: {error}; looking for it: supply (24 V), cable, adapter?"
                    self._say(Severity.WARNING, "sensor_silent", text)
                lost = True
                if self._link is not None:
                    self._link.close()
                    self._link = None
                self._closing.wait(TRY_S)

    def _same_as_before(self, said: str) -> None:
        if said != self._said:
            text = f"another FT 300 answers, {said}; it was {self._said}: its bias is another one, calibrate"
            self._say(Severity.WARNING, "sensor_changed", text)
            self._said = said

    def _back(self) -> None:
        self._say(Severity.INFO, "sensor_back", "the FT 300 sensor answers again")

    def _poll(self, link: Link, on_first: Callable[[], None] | None) -> None:
        due_s = time.monotonic()
        while not self._closing.is_set():
            asked_ns = time.monotonic_ns()
            wrench = link.wrench()
            if on_first is not None:
                on_first()
                on_first = None
            self._add((asked_ns + time.monotonic_ns()) // 2, wrench)
            due_s = max(due_s + self.period_s, time.monotonic() - self.period_s)
            self._closing.wait(max(0.0, due_s - time.monotonic()))

    def _stream(self, link: Link, on_first: Callable[[], None] | None) -> None:
        link.start_stream()
        reader = StreamReader()
        clock = self.clock = DeviceClock(best_delay_s=ADAPTER_S, max_drift_ppm=STREAM_PPM)
        damaged_before, number = self.counts.damaged, -1
        while not self._closing.is_set():
            data = link.stream_bytes()
            if not data:
                raise LinkLost(f"no packet for {SILENT_S:g} s")
            arrived_ns = time.monotonic_ns() - round(PACKET_S * 1e9)
            for lost, wrench in reader.take(data):
                if on_first is not None:
                    on_first()
                    on_first = None
                number += 1 + (lost if number >= 0 else 0)
                clock.observe(number / STREAM_HZ, arrived_ns)
                self._add(clock.to_host_ns(number / STREAM_HZ), wrench)
            if damaged_before + reader.lost > self.counts.damaged:
                self.counts.damaged = damaged_before + reader.lost
                text = f"{self.counts.damaged} packets of the FT 300 came damaged so far: look at its cable and shield"
                self._say(Severity.WARNING, "samples_missed", text, seldom=True)

    def _add(self, stamp_ns: int, wrench: Array) -> None:
        self.counts.received += 1
        with self._lock:
            self._samples.append((stamp_ns, wrench))
            del self._samples[:-4096]
        if abs(wrench[:3]).max() > RANGE_N or abs(wrench[3:]).max() > RANGE_NM:
            text = f"the FT 300 feels more than its range of {RANGE_N:g} N and {RANGE_NM:g} Nm: take the load off"
            self._say(Severity.ERROR, "sensor_overload", text, seldom=True)

    def _say(self, severity: Severity, code: str, text: str, seldom: bool = False) -> None:
        now_s = time.monotonic()
        if not seldom or now_s - self._told.get(code, -TELL_S) >= TELL_S:
            self._told[code] = now_s
            self._tell(severity, code, text)

    def close(self) -> None:
        """Stop the stream and let go; a second call does nothing."""
        if not self._closing.is_set():
            self._closing.set()
            self._thread.join()
            if self._link is not None:
                self._link.close()
