"""What the services write: cut into lines, stamped, kept one file a service, and read back in the order of time.

A line on disk is ``2026-01-31T12:00:00.000000Z text``; a file that reaches 10 MB becomes ``<service>.log.1``.
"""

import heapq
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

LARGEST_FILE_B = 10_000_000
LONGEST_LINE_B = 65_536
SUFFIX = ".log"


@dataclass(frozen=True)
class LogLine:
    """One line of one service; ``time`` is the launcher's wall clock in ISO 8601, UTC, and sorts as text."""

    service: str
    time: str
    text: str


def timestamp() -> str:
    """Now, in the form used in log files."""
    return datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


class LineSplitter:
    """Cuts a stream of bytes into lines of text; one without an end is cut at 64 KiB, so that it cannot fill memory."""

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, chunk: bytes) -> list[str]:
        """The lines that ``chunk`` completes."""
        *whole, self._pending = (self._pending + chunk).split(b"\n")
        while len(self._pending) > LONGEST_LINE_B:
            whole.append(self._pending[:LONGEST_LINE_B])
            self._pending = self._pending[LONGEST_LINE_B:]
        return [line.rstrip(b"\r").decode(errors="replace") for line in whole]

    def finish(self) -> list[str]:
        """What was left without a line end."""
        rest, self._pending = self._pending, b""
        return [rest.decode(errors="replace")] if rest else []


class LogWriter:
    """Appends to one service's log file, unbuffered, so that what a service said survives any death."""

    def __init__(self, path: Path) -> None:
        self._path = path
        if path.exists():
            self._set_aside()
        self._file = path.open("ab", buffering=0)

    def write(self, line: LogLine) -> None:
        """Append one line; raises OSError if the disk refuses it."""
        self._file.write(f"{line.time} {line.text}\n".encode())
        if self._file.tell() >= LARGEST_FILE_B:
            # the new one first: where the disk refuses it the old one is still there to write to
            self._set_aside()
            fresh = self._path.open("ab", buffering=0)
            self._file.close()
            self._file = fresh

    def close(self) -> None:
        """Close the file; closing twice is allowed."""
        self._file.close()

    def _set_aside(self) -> None:
        self._path.replace(self._path.with_name(self._path.name + ".1"))


class LogTail:
    """Reads one service's log file from its beginning, and on each :meth:`read` what has come since."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._service = path.name[: -len(SUFFIX)]
        self._splitter = LineSplitter()
        self._inode: int | None = None
        self._offset = 0

    def read(self) -> list[LogLine]:
        """The whole lines since the last call, in order; also across the file's being set aside."""
        chunks = [self._rest_of_set_aside()]
        try:
            with self._path.open("rb") as file:
                inode = os.fstat(file.fileno()).st_ino
                if inode != self._inode:
                    self._inode, self._offset = inode, 0
                file.seek(self._offset)
                chunks.append(file.read())
                self._offset += len(chunks[-1])
        except FileNotFoundError:
            pass
        return [self._parse(line) for chunk in chunks for line in self._splitter.feed(chunk)]

    def _rest_of_set_aside(self) -> bytes:
        """What came into the file being read between the last look and its being set aside, if it was."""
        try:
            with self._path.with_name(self._path.name + ".1").open("rb") as file:
                if os.fstat(file.fileno()).st_ino != self._inode:
                    return b""
                file.seek(self._offset)
                rest = file.read()
                self._offset += len(rest)
                return rest
        except FileNotFoundError:
            return b""

    def _parse(self, line: str) -> LogLine:
        time, _, text = line.partition(" ")
        return LogLine(self._service, time, text)


def merged(tails: list[LogTail]) -> Iterator[LogLine]:
    """What all tails have now, in the order of time."""
    return heapq.merge(*(tail.read() for tail in tails), key=lambda line: line.time)
