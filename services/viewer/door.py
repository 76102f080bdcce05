"""The port that people open: asks the gate about each connection, and passes it on to the page's own
server behind it.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import socket
import threading
from collections.abc import Iterator

from crosspih_common.errors import ConfigError
from services.viewer.gate import MOST_HEAD_BYTES, Gate, GateVerdict, head_of

FIRST_PORT, PORTS = 8080, 40
HEAD_S = 10.0  # time for a client to send the head of its request
PIECE = 65_536
PASSPORT = "X-Crosspih-Passport"  # the header by which the server behind the door knows who came through it


def listen(host: str, port: int | None) -> tuple[socket.socket, str]:
    """A socket that listens there, and a text where it is another port than the usual one.

    Without `port` the usual one, or the next that is free. Raises ConfigError, in one line.
    """
    for candidate in [port] if port is not None else range(FIRST_PORT, FIRST_PORT + PORTS):
        try:
            listening = _bound(host, candidate)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                why = error.strerror or str(error)
                raise ConfigError(
                    f"viewer.host: cannot listen on {host}: {why}; give an address of this machine"
                ) from None
            if port is not None:
                said = f"viewer.port: {port} on {host} is in use by another program; give another with --port"
                raise ConfigError(said) from None
            continue
        moved = "" if port is not None or candidate == FIRST_PORT else f"port {FIRST_PORT} is in use: this one instead"
        return listening, moved
    raise ConfigError(f"viewer.port: {FIRST_PORT} to {FIRST_PORT + PORTS - 1} are all in use; give one with --port")


def _bound(host: str, port: int) -> socket.socket:
    family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    found = socket.socket(family, kind, protocol)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind(address)
        found.listen(64)
    except OSError:
        found.close()
        raise
    return found


class Door:
    """Serves on a thread of its own until it is closed."""

    def __init__(self, listening: socket.socket, gate: Gate, page: bytes, behind_port: int, passport: str) -> None:
        self._gate, self._page, self._behind_port = gate, page, behind_port
        self._passport = f"{PASSPORT}: {passport}\r\n".encode()
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        self._thread = threading.Thread(target=self._run, args=(listening,), name="door", daemon=True)
        self._thread.start()

    def _run(self, listening: socket.socket) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve(listening))
        finally:
            self._loop.close()

    async def _serve(self, listening: socket.socket) -> None:
        server = await asyncio.start_server(self._connected, sock=listening, limit=MOST_HEAD_BYTES)
        await self._ended.wait()
        server.close()
        here = asyncio.current_task()
        rest = [task for task in asyncio.all_tasks() if task is not here]
        for task in rest:
            task.cancel()
        await asyncio.gather(*rest, return_exceptions=True)

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # cancelled: the door is being closed
        ends = (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.CancelledError)
        with _closing(writer), contextlib.suppress(*ends):
            try:
                first_lines = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), HEAD_S)
            except asyncio.TimeoutError:
                return
            verdict = self._gate.verdict(head_of(first_lines))
            if verdict is GateVerdict.PASS:
                await self._pass_on(first_lines, reader, writer)
                return
            writer.write(self._page if verdict is GateVerdict.PAGE else self._gate.answer(verdict))
            await writer.drain()

    async def _pass_on(self, first_lines: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        theirs, ours = await asyncio.open_connection("127.0.0.1", self._behind_port)
        with _closing(ours):
            request, _, headers = first_lines.partition(b"\r\n")
            ours.write(request + b"\r\n" + self._passport + headers)
            ways = [asyncio.ensure_future(_pump(reader, ours)), asyncio.ensure_future(_pump(theirs, writer))]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)

    def close(self) -> None:
        """Accept no more connections, and close those that are open."""
        with contextlib.suppress(RuntimeError):  # the loop has already ended by itself
            self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join(5.0)


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while piece := await reader.read(PIECE):
        writer.write(piece)
        await writer.drain()


@contextlib.contextmanager
def _closing(writer: asyncio.StreamWriter) -> Iterator[None]:
    try:
        yield
    finally:
        writer.close()
