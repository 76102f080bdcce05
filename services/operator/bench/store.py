"""Results that outlive their run: JSON lines, one a result, keyed by all that decides it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

from crosspih_common.errors import ConfigError


def result_key(identity: dict[str, Any]) -> str:
    """Twenty hex digits of what decides a result; the order of the names does not matter."""
    text = json.dumps(identity, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


class ResultStore:
    """A file of results. A line that was cut short by a kill is passed over; the last line of a key counts.

    One run writes to it at a time; each result is on the disk before the next is waited for.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._rows: dict[str, dict[str, Any]] = {}
        self._file: TextIO | None = None
        for line in self._lines():
            try:
                row = json.loads(line)
                self._rows[row["key"]] = row["result"]
            except (ValueError, KeyError, TypeError):
                continue

    def _lines(self) -> list[str]:
        try:
            return self.path.read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            return []
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"--store {self.path}: cannot be read ({error}); name a file of results") from None

    def __len__(self) -> int:
        return len(self._rows)

    def get(self, key: str) -> dict[str, Any] | None:
        """The result kept under a key, if any."""
        return self._rows.get(key)

    def put(self, key: str, result: dict[str, Any], **about: Any) -> None:
        """Keep a result; `about` stands beside it in the line, for people."""
        if self._file is None:
            self._open()
        assert self._file is not None
        self._file.write(json.dumps({"key": key, **about, "result": result}) + "\n")
        self._file.flush()
        self._rows[key] = result

    def _open(self) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("a+", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"--store {self.path}: cannot be written ({error.strerror})") from None
        # what a kill cut short must not swallow the next line
        content = self.path.read_bytes()
        if content and not content.endswith(b"\n"):
            self._file.write("\n")

    def close(self) -> None:
        """Let the file go; a second call does nothing."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def __enter__(self) -> ResultStore:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
