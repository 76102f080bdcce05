"""A store of results between runs: JSON lines, one per result, keyed by everything that decides it."""

from __future__ import annotations

import hashlib
import json
from datetime import datetime, timezone
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

from crosspih_common.errors import ConfigError
from crosspih_common.provenance.measured import Measured, record_measured


def result_key(identity: dict[str, Any]) -> str:
    """The key of a result, twenty hex digits: a hash of all that decides it, independent of the order of the names."""
    text = json.dumps(identity, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


class ResultStore:
    """A file of results. An incomplete line, as left by a kill, is skipped; the last line of a key counts.

    A key must hold all that decides its result: settings, the content of files, and the code. Each line says beside its
    result which code made it, when, and how long that took. One run writes to it at a time; each result is on the disk
    before the next is waited for.
    """

    def __init__(self, path: Path, option: str = "--store") -> None:
        self.path, self._option = path, option
        self._rows: dict[str, dict[str, Any]] = {}
        self._made: set[str] = set()
        self._taken: set[str] = set()
        self._file: TextIO | None = None
        self.without_key = 0
        for line in self._lines():
            try:
                row = json.loads(line)
                self._rows[row["key"]] = {**row, "result": row["result"]}
            except (ValueError, KeyError, TypeError):
                self.without_key += 1

    def _lines(self) -> list[str]:
        try:
            return self.path.read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            return []
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"{self._option} {self.path}: cannot be read ({error}); name a file of results") from None

    def __len__(self) -> int:
        return len(self._rows)

    def get(self, key: str) -> dict[str, Any] | None:
        """The result kept under a key, if any."""
        row = self._rows.get(key)
        if row is None:
            return None
        if key not in self._made:
            self._taken.add(key)
        result: dict[str, Any] = row["result"]
        return result

    def of_other_code(self, code: str) -> int:
        """How many of its results were made by other code, including those without a code version."""
        return sum(row.get("code") != code for row in self._rows.values())

    def put(
        self, key: str, result: dict[str, Any], *, code: str = "", took_s: float | None = None, **about: Any
    ) -> None:
        """Keep a result with the code that made it and the seconds that it took; `about` is extra text for people."""
        if self._file is None:
            self._open()
        assert self._file is not None
        at = datetime.now(timezone.utc).isoformat(timespec="seconds")
        row = {"key": key, "code": code, "at": at, "took_s": took_s, **about, "result": result}
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()
        self._rows[key] = row
        self._made.add(key)

    def measured(self) -> Measured:
        """How many results were taken from the store so far, and how many were added."""
        rows = [self._rows[key] for key in self._taken]
        took_s = [row.get("took_s") for row in rows]
        times = [str(row["at"]) for row in rows if row.get("at")]
        return Measured(
            taken=len(rows),
            made=len(self._made),
            taken_s=None if None in took_s else round(sum(value for value in took_s if value is not None), 3),
            first=min(times, default=""),
            last=max(times, default=""),
        )

    def reuse_summary(self, code: str) -> str:
        """A text of what a run of this code reuses and what it does not; empty if the store is empty."""
        parts = []
        if taken := self.measured().taken:
            parts.append(f"{taken} taken over from {self.path}, made by this code ({code})")
        if others := self.of_other_code(code) + self.without_key:
            parts.append(f"{others} in {self.path} by other code are left alone")
        return "; ".join(parts)

    def _open(self) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("a+", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{self._option} {self.path}: cannot be written ({error.strerror})") from None
        # end an incomplete last line, so that the next line is not appended to it
        content = self.path.read_bytes()
        if content and not content.endswith(b"\n"):
            self._file.write("\n")

    def close(self) -> None:
        """Close the file, and record what was taken over; a second call does nothing more."""
        if self._file is not None:
            self._file.close()
            self._file = None
        record_measured(self.measured())
        self._taken, self._made = set(), set()

    def __enter__(self) -> ResultStore:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
