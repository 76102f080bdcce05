"""A thin RTDE client: one connection to port 30004 that loses no package.

Protocol version 2 of Universal Robots' "Real-Time Data Exchange (RTDE) guide". ur-rtde, the client that most use, is
not taken: after a broken connection its threads gave up, or ended the process, and of packages that came together it
keeps the last one alone (docs/hardware/universal-robots.md has what was seen).
"""

from __future__ import annotations

import select
import socket
import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from crosspih_common.errors import DeviceLost

PORT = 30004
_HEADER = struct.Struct(">HB")
_CODES = {
    "BOOL": "?", "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "DOUBLE": "d", "VECTOR3D": "3d",
    "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I",
}  # fmt: skip
_SERVICES = "Settings, Security, Services on the pendant (PolyScope 5.10 on) must allow RTDE"


@dataclass(frozen=True, slots=True)
class Recipe:
    """The variables of one kind of data package, in their order."""

    number: int
    names: tuple[str, ...]
    form: struct.Struct
    sizes: tuple[int, ...]

    @classmethod
    def of(cls, number: int, names: Sequence[str], types: Sequence[str]) -> Recipe:
        """From the types that the controller answered."""
        form = struct.Struct(">" + "".join(_CODES[kind] for kind in types))
        return cls(
            number, tuple(names), form, tuple(int(kind[6]) if kind.startswith("VECTOR") else 1 for kind in types)
        )

    def unpack(self, body: bytes) -> dict[str, Any]:
        """Values by name; vectors as tuples. Raises struct.error where the size is another."""
        values = self.form.unpack(body)
        found: dict[str, Any] = {}
        at = 0
        for name, size in zip(self.names, self.sizes, strict=True):
            found[name] = values[at] if size == 1 else values[at : at + size]
            at += size
        return found


class NotKnown(Exception):
    """The controller does not have some variables; their names."""

    def __init__(self, names: list[str]) -> None:
        super().__init__(", ".join(names))
        self.names = names


class RtdeClient:
    """Connected once made. What goes wrong raises DeviceLost, whose text names the mend. One thread at a time."""

    def __init__(self, host: str, timeout_s: float) -> None:
        self._host, self._timeout_s = host, timeout_s
        try:
            self._socket = socket.create_connection((host, PORT), timeout=timeout_s)
        except OSError as error:
            raise DeviceLost(
                f"no RTDE connection to {host}:{PORT} ({error}); is the robot on, the cable in, hardware.ur.host "
                f"right? {_SERVICES}"
            ) from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._buffer = bytearray()
        self._outputs: Recipe | None = None
        try:
            self._negotiate()
        except BaseException:
            self.close()
            raise

    def _negotiate(self) -> None:
        if self._ask("V", struct.pack(">H", 2)) != b"\x01":
            raise DeviceLost(f"{self._host} does not speak RTDE protocol version 2; update PolyScope to 3.10 or 5.4 on")
        answer = self._ask("v", b"")
        if len(answer) < 16:
            raise DeviceLost(f"{self._host}: its RTDE port gives no version; is hardware.ur.host a robot?")
        self.version: tuple[int, int, int, int] = struct.unpack(">4I", answer[:16])

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    # ------------------------------------------------------------------------------------------------------- recipes

    def subscribe(self, names: Sequence[str], hertz: float) -> None:
        """The outputs to be sent, so often. Raises NotKnown where the controller does not have some."""
        answer = self._ask("O", struct.pack(">d", hertz) + ",".join(names).encode())
        types = answer[1:].decode().split(",")
        missing = [name for name, kind in zip(names, types, strict=False) if kind == "NOT_FOUND"]
        if missing or len(types) != len(names):
            raise NotKnown(missing or list(names))
        self._outputs = Recipe.of(answer[0], names, types)

    def inputs(self, names: Sequence[str]) -> Recipe:
        """A package of inputs that may be sent. Raises DeviceLost where somebody else has one of them."""
        answer = self._ask("I", ",".join(names).encode())
        types = answer[1:].decode().split(",")
        taken = [name for name, kind in zip(names, types, strict=False) if kind == "IN_USE"]
        if taken:
            raise DeviceLost(
                f"{', '.join(taken)} of {self._host} is in use; end the other RTDE program (another crosspih?), or "
                "free the upper registers from EtherNet/IP, PROFINET and MODBUS in the robot's installation"
            )
        if "NOT_FOUND" in types or len(types) != len(names):
            raise DeviceLost(f"{self._host} has no registers 24 to 47; update PolyScope to 3.9 or 5.3 on")
        return Recipe.of(answer[0], names, types)

    def start(self) -> None:
        """Let the packages come."""
        if self._ask("S", b"") != b"\x01":
            raise DeviceLost(f"{self._host} does not start to send")

    # ---------------------------------------------------------------------------------------------------------- data

    def send(self, recipe: Recipe, values: Sequence[float]) -> None:
        """One package of inputs."""
        self._say("U", bytes([recipe.number]) + recipe.form.pack(*values))

    def receive(self, wait_s: float) -> list[dict[str, Any]]:
        """All packages that have come, oldest first; waits for one. Raises DeviceLost where none comes in the time."""
        found = self._taken()
        until_s = time.monotonic() + wait_s
        while not found:
            left_s = until_s - time.monotonic()
            if left_s <= 0.0 or not select.select([self._socket], [], [], left_s)[0]:
                raise DeviceLost(
                    f"nothing came from {self._host} for {wait_s:.3g} s; the cable, the robot's power or its controller"
                )
            self._fill()
            found = self._taken()
        # what has come while the caller was busy
        while select.select([self._socket], [], [], 0.0)[0]:
            self._fill()
            found += self._taken()
        return found

    def _fill(self) -> None:
        try:
            data = self._socket.recv(65536)
        except OSError as error:
            raise DeviceLost(f"the connection to {self._host} broke ({error})") from None
        if not data:
            raise DeviceLost(f"{self._host} closed the connection; its controller was restarted or is shutting down")
        self._buffer += data

    def _messages(self) -> list[tuple[str, bytes]]:
        found = []
        while len(self._buffer) >= 3:
            size, kind = _HEADER.unpack_from(self._buffer)
            if size < 3:
                raise DeviceLost(f"{self._host} sent a message of {size} bytes: what answers there is no RTDE")
            if len(self._buffer) < size:
                break
            found.append((chr(kind), bytes(self._buffer[3:size])))
            del self._buffer[:size]
        return found

    def _taken(self) -> list[dict[str, Any]]:
        packages = []
        for kind, body in self._messages():
            if kind == "U" and self._outputs is not None and body[0] == self._outputs.number:
                try:
                    packages.append(self._outputs.unpack(body[1:]))
                except struct.error:
                    raise DeviceLost(f"{self._host} sent a package of another size than it agreed to") from None
        return packages

    def _say(self, kind: str, payload: bytes) -> None:
        try:
            self._socket.sendall(_HEADER.pack(3 + len(payload), ord(kind)) + payload)
        except OSError as error:
            raise DeviceLost(f"the connection to {self._host} broke ({error})") from None

    def _ask(self, kind: str, payload: bytes) -> bytes:
        self._say(kind, payload)
        until_s = time.monotonic() + self._timeout_s
        while True:
            for answered, body in self._messages():
                if answered == kind:
                    return body
            left_s = until_s - time.monotonic()
            if left_s <= 0.0 or not select.select([self._socket], [], [], left_s)[0]:
                raise DeviceLost(f"{self._host} does not answer on its RTDE port ({kind}); {_SERVICES}")
            self._fill()
