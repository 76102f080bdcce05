"""A peer in a process of its own: started, told what happens to it, ended."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from typing import Any, TextIO

from crosspih_common.modules import module_command


class PeerProcess:
    """`python -m MODULE ARGUMENTS`, which says `ready`, and answers each line that it is told by one of JSON."""

    def __init__(self, module: str, arguments: Sequence[str], errors: TextIO | None = None) -> None:
        self._process = subprocess.Popen(
            module_command(module, *arguments), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            stderr=subprocess.DEVNULL if errors is None else errors,
        )  # fmt: skip
        if not self._hears("ready"):
            raise RuntimeError(f"{module} {' '.join(arguments)} ended before it was ready")

    def _hears(self, word: str) -> bool:
        assert self._process.stdout is not None
        return any(line.strip() == word for line in iter(self._process.stdout.readline, ""))

    def tell(self, line: str) -> Any:
        """What it answers."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def close(self) -> None:
        """Have it end."""
        if self._process.stdin is not None and self._process.poll() is None:
            self._process.stdin.close()
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
