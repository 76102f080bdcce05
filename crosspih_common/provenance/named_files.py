"""The identity of a cell's file: files that it names count by their content, not by their name."""

from __future__ import annotations

import hashlib
import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import crosspih_common

_LONGEST_PATH = 1024


@lru_cache(maxsize=4096)
def _digest(path: str, size: int, changed_ns: int) -> str:
    # size and time are part of the cache key, so that a changed file is read again
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _content_of(text: str) -> str | None:
    """The digest of the file that a text names, relative to the services' folder or this one; None if it names none."""
    if not text or len(text) > _LONGEST_PATH or "\n" in text or "\0" in text:
        return None
    found = []
    below_packages = Path(next(iter(crosspih_common.__path__))).resolve().parent
    for folder in (Path(os.environ.get("CROSSPIH_DATA") or below_packages), Path.cwd()):
        path = folder / text
        try:
            if path.is_file():
                about = path.stat()
                found.append(_digest(str(path), about.st_size, about.st_mtime_ns))
        except OSError:
            continue
    # the suffix says how it is read
    return ",".join([*dict.fromkeys(found), Path(text).suffix]) if found else None


def with_file_contents(content: Any) -> Any:
    """A copy of a cell's file (or a part of it) in which each text that names a file is that file's digest.

    Relative names are looked for where services run (CROSSPIH_DATA, or beside the packages) and below the current
    folder. A text that names no file stays as it is.
    """
    if isinstance(content, dict):
        return {name: with_file_contents(value) for name, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [with_file_contents(value) for value in content]
    if isinstance(content, str) and (digest := _content_of(content)) is not None:
        return f"content {digest}"
    return content


def cell_identity(content: dict[str, Any]) -> dict[str, Any]:
    """The content of a cell's file that can change a result: all but the cell's name, files by their content."""
    cell = {name: value for name, value in (content.get("cell") or {}).items() if name != "name"}
    found: dict[str, Any] = with_file_contents({**content, "cell": cell})
    return found
