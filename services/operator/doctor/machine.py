"""Disk space, and permissions to read and write on this machine."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from crosspih_common.modules import RUN_DIR_VARIABLE
from services.operator.cli.rows import Row, ok, warning, wrong

MIN_BYTES, FEW_BYTES = 200_000_000, 2_000_000_000  # an assembly's recording and page take some 5 MB
RECEIVE_BUFFER = Path("/proc/sys/net/core/rmem_max")
# UDP datagrams that may wait: pictures by GigE Vision, and wrenches at 7 kHz
BUFFER_BYTES = {"genicam": 8_000_000, "ati": 200_000}
GROUPS = {"tty": "dialout", "video": "video"}


def disk_rows(folder: Path, least: int = MIN_BYTES, few: int = FEW_BYTES) -> Iterator[Row]:
    """The folder of recordings: can it be made and written, and is there room?"""
    name, setting = "disk", "recorder.directory in the cell's file"
    try:
        there = written_at(folder)
    except OSError as error:
        found = f"{error.filename or folder}: {error.strerror}; recordings go to {folder}"
        yield wrong(name, found, f"chown or mount it so that it can be written, or set {setting} to another folder")
        return
    free = shutil.disk_usage(there).free
    found = f"{free / 1e9:.1f} GB free for {folder}; an assembly takes some 5 MB"
    if free < least:
        yield wrong(name, found, f"make room, or set {setting} to another disk")
    elif free < few:
        yield warning(name, found, f"make room, or set {setting} to another disk")
    else:
        yield ok(name, found)


def state_rows(folder: Path) -> Iterator[Row]:
    """The folder in which a stack keeps its state and logs; no row where it can be written."""
    try:
        written_at(folder)
    except OSError as error:
        found = f"{error.filename or folder}: {error.strerror}; a stack keeps its state and logs in {folder}"
        yield wrong("state of stacks", found, f"chown it, or set {RUN_DIR_VARIABLE} to another folder")


def written_at(folder: Path) -> Path:
    """The folder, or its nearest existing parent, after a temporary file was written there and removed.

    Raises OSError: it is a file, is read-only, is full, or may not be entered. Permission bits alone do not show all of
    these.
    """
    there = folder.resolve()
    while not there.exists():
        there = there.parent
    try:
        with tempfile.TemporaryFile(dir=there) as file:
            file.write(b"crosspih doctor")
            file.flush()
    except OSError as error:
        error.filename = str(there)
        raise
    return there


def device_file_rows(files: Sequence[tuple[str, str]]) -> Iterator[Row]:
    """The device files in the cell's file: (setting, path)."""
    for setting, path in files:
        name = f"{setting} {path}"
        try:
            mode = os.stat(path).st_mode
        except FileNotFoundError:
            yield wrong(name, "is not there", "plug it in; name it by /dev/serial/by-id or /dev/v4l/by-id")
            continue
        except OSError as error:
            yield wrong(name, f"cannot be looked at: {error.strerror}", "see who may read its folder")
            continue
        if not stat.S_ISCHR(mode):
            yield wrong(name, "is no device", "name the device's own file in /dev")
        elif not os.access(path, os.R_OK | os.W_OK):
            group = next((group for part, group in GROUPS.items() if part in path), "its group")
            yield wrong(name, "may not be read and written", f"sudo usermod -aG {group} $USER, then log in anew")
        else:
            yield ok(name, "is there and may be read and written")


def buffer_rows(drivers: set[str], file: Path = RECEIVE_BUFFER) -> Iterator[Row]:
    """How many bytes of datagrams the kernel buffers at most, where a driver receives many."""
    needed = max((BUFFER_BYTES[name] for name in drivers if name in BUFFER_BYTES), default=0)
    if not needed:
        return
    try:
        have = int(file.read_text(encoding="ascii"))
    except (OSError, ValueError):
        yield warning("receive buffer", f"{file} cannot be read", f"see that sockets may hold {needed} bytes")
        return
    if have < needed:
        mend = f"sudo sysctl -w net.core.rmem_max={needed}; for good: a file in /etc/sysctl.d"
        yield warning("receive buffer", f"{have} bytes at most, {needed} are wanted: datagrams will be lost", mend)
    else:
        yield ok("receive buffer", f"{have} bytes at most, {needed} are wanted")
