"""The receiving end of ``sd_notify``: one Unix datagram socket a service, read by the launcher's event loop."""

import asyncio
import contextlib
import shutil
import socket
import tempfile
from collections.abc import Callable
from pathlib import Path

# sockaddr_un holds 108 bytes on Linux and 104 on macOS, the closing zero included.
_LONGEST_PATH_B = 100
_NAME_B = 64  # of a service
_DATAGRAM_B = 8192


class NotifyFolder:
    """Where the sockets lie: ``preferred``, or a private temporary folder if its path is too long for a socket."""

    def __init__(self, preferred: Path) -> None:
        self._temporary = not _has_room(preferred.resolve())
        self.path = _temporary_folder() if self._temporary else preferred.resolve()
        self.path.mkdir(mode=0o700, parents=True, exist_ok=True)

    def remove(self) -> None:
        """Remove the folder and what is left in it."""
        shutil.rmtree(self.path, ignore_errors=True)


def _has_room(folder: Path) -> bool:
    """Whether a socket of any service's name fits in."""
    return len(str(folder).encode()) <= _LONGEST_PATH_B - len(".sock") - _NAME_B


def _temporary_folder() -> Path:
    """The user's own one may be too deep as well: then the system's."""
    made = Path(tempfile.mkdtemp(prefix="crosspih-"))
    if not _has_room(made) and Path("/tmp").is_dir():
        made.rmdir()
        made = Path(tempfile.mkdtemp(prefix="crosspih-", dir="/tmp"))
    return made


class NotifySocket:
    """Hands every datagram of one service to ``on_message`` until closed. Use within a running event loop."""

    def __init__(self, path: Path, on_message: Callable[[bytes], None]) -> None:
        self.path = path
        self._on_message = on_message
        path.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._socket.setblocking(False)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._socket.fileno(), self._read)

    def drain(self) -> None:
        """Drop what a process that has ended still left in the socket, so that it does not count for its successor."""
        with contextlib.suppress(BlockingIOError):
            while True:
                self._socket.recv(_DATAGRAM_B)

    def close(self) -> None:
        """Stop reading and remove the socket."""
        self._loop.remove_reader(self._socket.fileno())
        self._socket.close()
        self.path.unlink(missing_ok=True)

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                self._on_message(self._socket.recv(_DATAGRAM_B))
