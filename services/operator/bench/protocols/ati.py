"""`python -m services.operator.bench.protocols.ati`: a box that speaks ATI's Net F/T protocol, without a sensor.

It serves netftapi2.xml by HTTP and RDT by UDP, as ATI's manuals 9620-05-NET FT and 9610-05-Ethernet Axia describe
them. It is written from these manuals alone and shares no code with the driver. When it serves it prints
`ready rdt PORT http PORT feed PORT`.

The wrench that it measures is fed to it: UDP datagrams to the feed port of 48 bytes each, six little-endian doubles,
Fx Fy Fz in N, Tx Ty Tz in Nm; the last one holds until the next. A simulated cell sends one a step (docs/examples/
sensor_behind_protocol.py); before the first one the wrench is `--wrench`. Like the real box it samples the wrench by
its own clock, which is wrong by `--drift-ppm`, so the feed and the reader may run at different rates, each up to 7 kHz.

On standard input it takes one command a line:

    status 0x80020000      the status word from now on
    skip N                 send nothing of the next N records, though they are counted
    twice, swap            send the next record twice; exchange the next two
    hold S                 keep all records back for S seconds, then send them at once: a busy network
    unplug S               nothing comes in or goes out for S seconds; the box runs on
    off S                  without power for S seconds: then it counts from 0 and streams nothing until asked
    set FIELD VALUE        a field of its page, such as cfgcalsn
    quit
"""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import struct
import sys
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from xml.sax.saxutils import escape

from services.operator.bench.protocols.feed import Feed, Wrench, udp

_REQUEST, _RECORD = struct.Struct(">HHI"), struct.Struct(">IIIiiiiii")
_MAGIC, _STOP, _START, _START_BUFFERED, _BIAS = 0x1234, 0x0000, 0x0002, 0x0003, 0x0042
_LARGEST_COUNT = 2**31 - 1
TIME_S = 1000.0  # the clock counts modulo this
# counts per N, or per Nm
FORCE = {"N": 1.0, "kN": 1e-3, "lbf": 1 / 4.4482216152605, "klbf": 1e-3 / 4.4482216152605, "kgf": 1 / 9.80665}
TORQUE = {
    "N-m": 1.0, "Nm": 1.0, "N-mm": 1e3, "kN-m": 1e-3, "lbf-in": 1 / (4.4482216152605 * 0.0254),
    "lbf-ft": 1 / (4.4482216152605 * 0.3048), "kgf-cm": 1 / 0.0980665,
}  # fmt: skip


class NetBox:
    """The box: `run` serves until `quit` is set. `feels` may be given instead of a feed: it returns the present wrench
    (6,), N and Nm.
    """

    def __init__(
        self, fields: dict[str, str], internal_hz: float, rate_hz: float, drift_ppm: float = 0.0,
        feels: Callable[[], Wrench] | None = None, host: str = "127.0.0.1", rdt_port: int = 0, http_port: int = 0,
        feed_port: int = 0, tell_time: bool = False,
    ) -> None:  # fmt: skip
        self.fields = fields
        self._internal_hz = internal_hz
        self._true_hz = internal_hz * (1.0 + drift_ppm * 1e-6)
        self._step = max(1, int(internal_hz / rate_hz + 1e-9))  # the rate is a whole fraction, rounded up
        fields.setdefault("runrate", f"{internal_hz:g}")
        fields["comrdtrate"] = f"{internal_hz / self._step:.0f}"
        self.feed = Feed(host, feed_port)
        self._tell_time = tell_time
        self._feels = feels or (lambda: self.feed.wrench)
        self._rdt = udp(host, rdt_port)
        self._http = ThreadingHTTPServer((host, http_port), self._handler())
        self._http.daemon_threads = True
        self.rdt_port, self.http_port = self._rdt.getsockname()[1], self._http.server_address[1]
        self.quit = threading.Event()
        self.status, self._skip, self._twice, self._swap = 0, 0, False, False
        self._unplugged_until_s = self._hold_until_s = 0.0
        self._off_until_s: float | None = None
        self.sent = 0  # records sent, to compute how many were lost on the way
        self._power_up()

    def _power_up(self) -> None:
        self._powered_s = time.monotonic()
        self._client: tuple[str, int] | None = None
        self._left: int | None = None
        self._rdt_sequence = 0
        self._next_ft = 0
        self._bias: tuple[int, ...] = (0, 0, 0, 0, 0, 0)
        self.fields["setbias"] = "0;0;0;0;0;0"
        self._swapped: bytes | None = None

    # ----------------------------------------------------------------------------------------------------- the page

    def page(self) -> bytes:
        """The page netftapi2.xml."""
        told = {**self.fields, "runstat": f"0x{self.status:08X}"}
        inner = "".join(f"<{name}>{escape(value)}</{name}>\n" for name, value in told.items())
        return f'<?xml version="1.0"?>\n<netft>\n{inner}</netft>\n'.encode()

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        box = self

        class Page(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if box.away():
                    self.close_connection = True
                    return
                found = self.path.partition("?")[0] == "/netftapi2.xml"
                body = box.page() if found else b"<html>no such page</html>"
                self.send_response(200 if found else 404)
                self.send_header("Content-Type", "text/xml" if found else "text/html")
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:
                """Nothing."""

        return Page

    # ----------------------------------------------------------------------------------------------------- the stream

    def away(self) -> bool:
        """Whether it cannot be reached now."""
        return self._off_until_s is not None or time.monotonic() < self._unplugged_until_s

    def run(self) -> None:
        """Serve."""
        pages = threading.Thread(target=self._http.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
        pages.start()
        try:
            while not self.quit.is_set():
                self._turn()
        finally:
            self._http.shutdown()
            self._http.server_close()
            self._rdt.close()
            self.feed.close()

    def _turn(self) -> None:
        now_s = time.monotonic()
        if self._off_until_s is not None and now_s >= self._off_until_s:
            self._off_until_s = None
            self._power_up()
        due_s = self._powered_s + self._next_ft / self._true_hz
        wait_s = min(max(due_s - now_s, 0.0), 0.05) if self._client is not None else 0.05
        ready, _, _ = select.select([self._rdt, self.feed.socket], [], [], wait_s)
        if self.feed.socket in ready:
            self.feed.take()
        if self._rdt in ready:
            self._be_asked()
        self._send_due()

    def _be_asked(self) -> None:
        try:
            data, sender = self._rdt.recvfrom(2048)
        except OSError:
            return
        if self.away() or len(data) != _REQUEST.size:
            return
        magic, command, count = _REQUEST.unpack(data)
        if magic != _MAGIC:
            return
        if command in (_START, _START_BUFFERED):
            self._client, self._left, self._rdt_sequence = sender, count or None, 0
            self._next_ft = (self._counted() // self._step + 1) * self._step
        elif command == _STOP:
            self._client = None
        elif command == _BIAS:
            self._bias = (0, 0, 0, 0, 0, 0)
            self._bias = self._counts()
            self.fields["setbias"] = ";".join("1" for _ in range(6))

    def _counted(self) -> int:
        return int((time.monotonic() - self._powered_s) * self._true_hz)

    def _counts(self, time_s: float | None = None) -> tuple[int, ...]:
        felt = self._feels() if time_s is None else (time_s, 0.0, 0.0, 0.0, 0.0, 0.0)
        per_n = float(self.fields["cfgcpf"]) * FORCE[self.fields["scfgfu"]]
        per_nm = float(self.fields["cfgcpt"]) * TORQUE[self.fields["scfgtu"]]
        counts = [round(one * per) for one, per in zip(felt, (per_n,) * 3 + (per_nm,) * 3, strict=True)]
        return tuple(
            max(-_LARGEST_COUNT, min(_LARGEST_COUNT, one - zero)) for one, zero in zip(counts, self._bias, strict=True)
        )

    def _send_due(self) -> None:
        if self._client is None or self._off_until_s is not None:
            return
        now_s = time.monotonic()
        if now_s < self._hold_until_s:
            return
        counted = int((now_s - self._powered_s) * self._true_hz)
        if counted < self._next_ft:
            return
        counts = self._counts()
        unplugged = now_s < self._unplugged_until_s
        while self._next_ft <= counted and self._client is not None:
            self._rdt_sequence = (self._rdt_sequence + 1) & 0xFFFFFFFF
            if self._tell_time:
                counts = self._counts((self._powered_s + self._next_ft / self._true_hz) % TIME_S)
            record = _RECORD.pack(self._rdt_sequence, self._next_ft & 0xFFFFFFFF, self.status, *counts)
            self._next_ft += self._step
            if self._left is not None:
                self._left -= 1
            if self._skip > 0:
                self._skip -= 1
            elif not unplugged:
                self._send(record)
            if self._left == 0:
                self._client = None

    def _send(self, record: bytes) -> None:
        if self._swap and self._swapped is None:
            self._swapped, self._swap = record, False
            return
        pieces = [record] * (2 if self._twice else 1)
        self._twice = False
        if self._swapped is not None:
            pieces.append(self._swapped)
            self._swapped = None
        for piece in pieces:
            with contextlib.suppress(OSError):
                self._rdt.sendto(piece, self._client or ("", 0))
                self.sent += 1

    # -------------------------------------------------------------------------------------------------------- commands

    def command(self, line: str) -> None:
        """One of the commands in the module's docstring. Raises ValueError, IndexError on others."""
        word, *rest = line.split()
        now_s = time.monotonic()
        if word == "status":
            self.status = int(rest[0], 0)
        elif word == "skip":
            self._skip = int(rest[0])
        elif word == "twice":
            self._twice = True
        elif word == "swap":
            self._swap = True
        elif word == "hold":
            self._hold_until_s = now_s + float(rest[0])
        elif word == "unplug":
            self._unplugged_until_s = now_s + float(rest[0])
        elif word == "off":
            self._off_until_s = now_s + float(rest[0])
        elif word == "set":
            self.fields[rest[0]] = " ".join(rest[1:])
        elif word == "quit":
            self.quit.set()
        else:
            raise ValueError(f"no command {word!r}")


def fields_of(arguments: argparse.Namespace) -> dict[str, str]:
    """The fields of the page as configured."""
    return {
        "prodname": arguments.product,
        "cfgnam": "crosspih peer",
        "cfgcalsel": "0",
        "cfgcalsn": arguments.calibration,
        "scfgfu": arguments.force_unit,
        "scfgtu": arguments.torque_unit,
        "cfgcpf": f"{arguments.counts_per_force:g}",
        "cfgcpt": f"{arguments.counts_per_torque:g}",
        "cfgtfx": "0;0;0;0;0;0",
        "cfgmr": ";".join(f"{one:g}" for one in arguments.ratings),
        "setbias": "0;0;0;0;0;0",
        "setuserfilter": "0",
        "comrdte": "Enabled",
        "comrdtbsiz": "1",
        "mfgdigver": "2.2.59",
    }


def main() -> None:
    """Serve until `quit`, or until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--rdt-port", type=int, default=49152)
    parser.add_argument("--http-port", type=int, default=8080)
    parser.add_argument("--feed-port", type=int, default=49160)
    parser.add_argument("--rate", type=float, default=1000.0, help="RDT output rate, Hz")
    parser.add_argument("--internal-rate", type=float, default=7000.0, help="at which it samples, Hz")
    parser.add_argument("--drift-ppm", type=float, default=0.0, help="by how much its clock is fast")
    parser.add_argument("--product", default="Net F/T")
    parser.add_argument("--calibration", default="FT00000")
    parser.add_argument("--force-unit", default="N", choices=sorted(FORCE))
    parser.add_argument("--torque-unit", default="N-m", choices=sorted(TORQUE))
    parser.add_argument("--counts-per-force", type=float, default=1e6)
    parser.add_argument("--counts-per-torque", type=float, default=1e6)
    parser.add_argument("--ratings", type=float, nargs=6, default=(330.0, 330.0, 990.0, 30.0, 30.0, 30.0))
    parser.add_argument("--wrench", type=float, nargs=6, default=(0.0,) * 6, help="felt until it is fed, N and Nm")
    parser.add_argument(
        "--tell-time",
        action="store_true",
        help="Fx is the monotonic time of each sample, s modulo 1000: to test stamps",
    )
    parser.add_argument("--stay", action="store_true", help="serve on when standard input ends, until it is ended")
    arguments = parser.parse_args()
    box = NetBox(
        fields_of(arguments), arguments.internal_rate, arguments.rate, arguments.drift_ppm, None, arguments.host,
        arguments.rdt_port, arguments.http_port, arguments.feed_port, arguments.tell_time,
    )  # fmt: skip
    box.feed.wrench = tuple(arguments.wrench)

    def heed() -> None:
        for line in sys.stdin:
            try:
                if line.strip():
                    box.command(line)
            except (ValueError, IndexError) as error:
                print(f"not understood: {line.strip()} ({error})", flush=True)
        if not arguments.stay:
            box.quit.set()

    threading.Thread(target=heed, daemon=True).start()
    print(f"ready rdt {box.rdt_port} http {box.http_port} feed {box.feed.port}", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        box.run()
    sys.stdout.flush()
    os._exit(0)  # a thread may still wait for standard input


if __name__ == "__main__":
    main()
