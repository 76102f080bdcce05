"""Simulated devices as processes: started, waited for, queried, and ended."""

from __future__ import annotations

import contextlib
import queue
import subprocess
import threading
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

from crosspih_common.errors import NoService
from crosspih_common.modules import module_command
from deploy.launcher import tethered

READY_S, ANSWER_S, END_S = 60.0, 10.0, 10.0
_LAST_LINES = 6


class Peer:
    """A module that runs as a process: it prints a line on standard output when it is ready, and answers each line with
    a line.

    It ends with the thread that made it, also where that is killed.
    """

    def __init__(self, name: str, words: list[str], environment: Mapping[str, str], folder: Path) -> None:
        self.name = name
        self._log = (folder / f"{name}.log").open("w+", encoding="utf-8")
        self._process = subprocess.Popen(
            tethered(module_command(*words)), env=dict(environment),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, text=True,
        )  # fmt: skip
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._said: deque[str] = deque(maxlen=_LAST_LINES)
        self._reader = threading.Thread(target=self._read, name=f"peer:{name}", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._said.append(line.strip())
            self._lines.put(line.strip())
        self._lines.put(None)

    def line(self, starts: str = "", deadline_s: float = READY_S) -> str:
        """The next line that starts with this. Raises NoService when the process ends first or prints nothing."""
        while True:
            try:
                line = self._lines.get(timeout=deadline_s)
            except queue.Empty:
                raise NoService(f"{self.name}: said nothing within {deadline_s:g} s; {self.last_words()}") from None
            if line is None:
                raise NoService(f"{self.name}: ended; {self.last_words()}")
            if line.startswith(starts):
                return line

    def ask(self, line: str) -> str:
        """The answer to a line. Raises NoService."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line + "\n")
            self._process.stdin.flush()
        except OSError as error:
            raise NoService(f"{self.name}: {error}; {self.last_words()}") from None
        return self.line(deadline_s=ANSWER_S)

    def last_words(self) -> str:
        """The last lines that it wrote."""
        if self._log.closed:
            return " / ".join(self._said)
        self._log.seek(0)
        return " / ".join([*self._said, *self._log.read().strip().splitlines()[-_LAST_LINES:]])

    def close(self) -> None:
        """End it; a second call does nothing."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._reader.join()
        assert self._process.stdin is not None and self._process.stdout is not None
        with contextlib.suppress(OSError):  # data that was not yet written is discarded
            self._process.stdin.close()
        self._process.stdout.close()
        self._log.close()

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
