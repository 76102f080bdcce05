"""Child processes: each leader of its own session and process group, tied to the launcher's life."""

import asyncio
import contextlib
import errno
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from crosspih_common.modules import is_ours, module_command
from deploy.launcher.logfile import LineSplitter

_HERE = Path(__file__).parent
_CHUNK_B = 65_536
# How long to wait for output that is still in the pipe after the whole group was killed.
_DRAIN_S = 0.5


def _script(name: str) -> list[str]:
    # Isolated and without site: it starts in some 15 ms, and nothing in the environment can reach it.
    return [sys.executable, "-I", "-S", str(_HERE / name)]


def tethered(command: Sequence[str]) -> list[str]:
    """A command that the kernel ends when the thread that starts it is gone, however that ends (Linux)."""
    return [*_script("tethered_exec.py"), str(os.getpid()), *command]


def resolve_python(command: Sequence[str]) -> list[str]:
    """The command with ``python`` or ``python3`` as its first word replaced by the launcher's own interpreter; a module
    of ours is then run from where this installation lies, whatever lies in the folder that it is run in."""
    python = command[0] in ("python", "python3")
    if python and len(command) > 2 and command[1] == "-m" and is_ours(command[2]):
        return module_command(*command[2:])
    return [sys.executable if command[0] in ("python", "python3") else command[0], *command[1:]]


def _require_program(word: str, search_path: str | None, working_dir: Path) -> None:
    """Raise FileNotFoundError if there is no such program, before a process is made that could only fail."""
    found = os.access(working_dir / word, os.X_OK) if "/" in word else shutil.which(word, path=search_path)
    if not found:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), word)


class ServiceProcess:
    """One run of one service. Made by :meth:`start`; every line it writes goes to ``on_line``."""

    def __init__(self, process: asyncio.subprocess.Process, pump: "asyncio.Task[None]") -> None:
        self._process = process
        self._pump = pump

    @classmethod
    async def start(
        cls,
        command: Sequence[str],
        environment: Mapping[str, str],
        working_dir: Path,
        on_line: Callable[[str], None],
    ) -> "ServiceProcess":
        """Start ``command``; raises OSError if it or ``working_dir`` does not exist, or no process can be made.

        The output pipe is ours and not asyncio's, whose ``wait`` in some releases waits for the pipe to close too,
        which a grandchild can hold open.
        """
        if working_dir.is_dir():
            _require_program(resolve_python(command)[0], environment.get("PATH"), working_dir)
        read_end, write_end = os.pipe()
        try:
            process = await asyncio.create_subprocess_exec(
                *tethered(resolve_python(command)),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=write_end,
                stderr=write_end,
                cwd=working_dir,
                env=dict(environment),
                start_new_session=True,
            )
        except BaseException:
            os.close(read_end)
            raise
        finally:
            os.close(write_end)
        return cls(process, asyncio.create_task(_pump_lines(read_end, on_line)))

    @property
    def pid(self) -> int:
        """The process, and process group, identifier."""
        return self._process.pid

    async def wait(self) -> int:
        """Wait for the end; kill what is left of its group, take its last lines, and return its exit code."""
        exit_code = await self._process.wait()
        self.signal_group(signal.SIGKILL)
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._pump, _DRAIN_S)
        return exit_code

    def signal_group(self, number: signal.Signals) -> None:
        """Send a signal to the whole group; nothing happens if it has gone."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, number)


async def _pump_lines(read_end: int, on_line: Callable[[str], None]) -> None:
    reader = asyncio.StreamReader()
    transport, _ = await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(read_end, "rb", buffering=0)
    )
    splitter = LineSplitter()
    try:
        while chunk := await reader.read(_CHUNK_B):
            for line in splitter.feed(chunk):
                on_line(line)
    finally:
        transport.close()
        for line in splitter.finish():
            on_line(line)


async def passes(test: Sequence[str], environment: Mapping[str, str], working_dir: Path, timeout_s: float) -> bool:
    """Run one healthcheck and return whether it ended with exit status 0 within ``timeout_s``."""
    try:
        process = await ServiceProcess.start(test, environment, working_dir, lambda _line: None)
    except OSError:
        return False
    ended = asyncio.ensure_future(process.wait())
    try:
        return await asyncio.wait_for(asyncio.shield(ended), timeout_s) == 0
    except asyncio.TimeoutError:
        return False
    finally:
        if not ended.done():
            process.signal_group(signal.SIGKILL)
            await ended


class Guard:
    """The launcher's end of guard.py; started again if someone ended it."""

    def __init__(self) -> None:
        self._groups: set[int] = set()
        self._process = self._start()

    def watch(self, pgid: int) -> None:
        """End this group should the launcher die."""
        self._groups.add(pgid)
        self._tell(f"+{pgid}\n")

    def release(self, pgid: int) -> None:
        """The group has gone by itself."""
        self._groups.discard(pgid)
        self._tell(f"-{pgid}\n")

    def close(self) -> None:
        """End the guard; groups still watched are ended by it."""
        with contextlib.suppress(OSError):
            self._pipe_fd_close()
        self._process.wait()

    @staticmethod
    def _start() -> "subprocess.Popen[bytes]":
        return subprocess.Popen(
            _script("guard.py"), stdin=subprocess.PIPE, start_new_session=True, bufsize=0, stdout=subprocess.DEVNULL
        )

    def _tell(self, message: str) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(message.encode())
        except BrokenPipeError:
            self.close()
            self._process = self._start()
            assert self._process.stdin is not None
            self._process.stdin.write("".join(f"+{pgid}\n" for pgid in self._groups).encode())

    def _pipe_fd_close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
