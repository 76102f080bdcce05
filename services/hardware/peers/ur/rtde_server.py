"""The RTDE port: negotiation, recipes, and data packages both ways, protocol version 2 (the maker's RTDE guide)."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from typing import Any

from services.hardware.peers.ur.robot import Outputs, Robot
from services.hardware.peers.ur.variables import FORMATS, INPUTS, OUTPUTS, known

PROTOCOL = 2


class RtdeSession:
    """One client's connection."""

    def __init__(self, connection: socket.socket, robot: Robot, claims: dict[str, RtdeSession]) -> None:
        self._socket, self._robot, self._claims = connection, robot, claims
        self._sending = threading.Lock()
        self._outputs: tuple[str, ...] = ()
        self._pack = struct.Struct(">B")
        self._every = 1
        self._inputs: dict[int, tuple[tuple[str, ...], struct.Struct, tuple[int, ...]]] = {}
        self.started = False
        self.dropped = 0

    def run(self) -> None:
        """Answer until the client is gone."""
        try:
            while header := self._exactly(3):
                size, kind = struct.unpack(">HB", header)
                self._answer(chr(kind), self._exactly(size - 3) if size > 3 else b"")
        except (OSError, struct.error):
            pass
        finally:
            self.started = False
            for name in [name for name, owner in self._claims.items() if owner is self]:
                del self._claims[name]
            self._socket.close()

    def close(self, abruptly: bool = True) -> None:
        """End the connection; abruptly, as a controller that dies does."""
        with contextlib.suppress(OSError):
            if abruptly:
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            self._socket.shutdown(socket.SHUT_RDWR)

    def offer(self, outputs: Outputs, cycle: int) -> None:
        """Send a package, where one is due; one that would have to wait for a slow client is dropped."""
        if not self.started or cycle % self._every:
            return
        values: list[Any] = []
        for name in self._outputs:
            value = outputs[name]
            if isinstance(value, list):
                values.extend(value)
            elif OUTPUTS[name].startswith("VECTOR"):
                values.extend([0] * int(OUTPUTS[name][6]))
            else:
                values.append(value)
        packed = self._pack.pack(1, *values)
        with contextlib.suppress(OSError), self._sending:
            try:
                self._socket.sendall(struct.pack(">HB", 3 + len(packed), ord("U")) + packed, socket.MSG_DONTWAIT)
            except BlockingIOError:
                self.dropped += 1

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self._socket.recv(count - len(data))
            if not more:
                return b""
            data += more
        return data

    def _say(self, kind: str, payload: bytes) -> None:
        with self._sending:
            self._socket.sendall(struct.pack(">HB", 3 + len(payload), ord(kind)) + payload)

    def _answer(self, kind: str, payload: bytes) -> None:
        if kind == "V":
            self._say("V", bytes([int.from_bytes(payload, "big") == PROTOCOL]))
        elif kind == "v":
            self._say("v", struct.pack(">4I", *self._robot.version))
        elif kind == "O":
            self._say("O", self._outputs_asked(payload))
        elif kind == "I":
            self._say("I", self._inputs_asked(payload))
        elif kind in "SP":
            self._say(kind, b"\x01")
            self.started = kind == "S" and bool(self._outputs)
        elif kind == "U" and self.started:
            self._take(payload)

    def _outputs_asked(self, payload: bytes) -> bytes:
        (hertz,) = struct.unpack(">d", payload[:8])
        names = _names(payload[8:])
        types = [OUTPUTS[name] if known(name, self._robot.version) else "NOT_FOUND" for name in names]
        if "NOT_FOUND" in types:
            return b"\x00" + ",".join(types).encode()
        self._every = max(1, round(1.0 / (self._robot.period_s * hertz))) if hertz > 0.0 else 1
        self._outputs = tuple(names)
        self._pack = struct.Struct(">B" + "".join(FORMATS[kind] for kind in types))
        return b"\x01" + ",".join(types).encode()

    def _inputs_asked(self, payload: bytes) -> bytes:
        names = _names(payload)
        types = []
        for name in names:
            taken = self._claims.get(name)
            types.append("NOT_FOUND" if name not in INPUTS else "IN_USE" if taken not in (None, self) else INPUTS[name])
        if {"NOT_FOUND", "IN_USE"} & set(types):
            return b"\x00" + ",".join(types).encode()
        for name in names:
            self._claims[name] = self
        number = len(self._inputs) + 1
        sizes = tuple(int(kind[6]) if kind.startswith("VECTOR") else 1 for kind in types)
        self._inputs[number] = (tuple(names), struct.Struct(">" + "".join(FORMATS[kind] for kind in types)), sizes)
        return bytes([number]) + ",".join(types).encode()

    def _take(self, payload: bytes) -> None:
        recipe = self._inputs.get(payload[0])
        if recipe is None or len(payload) != 1 + recipe[1].size:
            self._robot.say(f"a data package of recipe {payload[0]} with {len(payload) - 1} bytes fits none")
            return
        names, form, sizes = recipe
        values = list(form.unpack(payload[1:]))
        with self._robot.lock:
            for name, size in zip(names, sizes, strict=True):
                taken = [values.pop(0) for _ in range(size)]
                self._robot.write_input(name, taken if size > 1 else taken[0])


def _names(text: bytes) -> list[str]:
    return [name.strip() for name in text.decode().split(",") if name.strip()]
