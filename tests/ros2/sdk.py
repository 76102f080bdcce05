"""Runs zenoh-ros2-sdk as a process beside the test, and reads the JSON lines that it says."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
DEADLINE_S = 30.0


class SdkProcess:
    """`python -m tests.peers.ros2_sdk ...`."""

    def __init__(self, endpoint: str, definitions: Path, *arguments: str, domain: int = 0) -> None:
        port = endpoint.rsplit(":", 1)[1]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.peers.ros2_sdk", "--port", port, "--domain", str(domain), "--definitions",
             str(definitions), *arguments],
            cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        self._lines: queue.Queue[str | None] = queue.Queue()
        self.noise: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)
        self._lines.put(None)

    def said(self, key: str, deadline_s: float = DEADLINE_S) -> dict[str, Any]:
        """The next line that is an object with this key; fails the test at the deadline or at the end."""
        return self.said_any({key}, deadline_s)

    def said_any(self, keys: set[str], deadline_s: float = DEADLINE_S) -> dict[str, Any]:
        """The next line that is an object with one of these keys."""
        until = time.monotonic() + deadline_s
        while True:
            try:
                line = self._lines.get(timeout=max(until - time.monotonic(), 0.001))
            except queue.Empty:
                pytest.fail(f"the SDK's process did not say any of {keys}: {''.join(self.noise)}")
            if line is None:
                pytest.fail(f"the SDK's process ended and did not say any of {keys}: {''.join(self.noise)}")
            if line.startswith("{"):
                said: dict[str, Any] = json.loads(line)
                if keys & said.keys():
                    return said
            self.noise.append(line)

    def said_all(self, *keys: str) -> list[dict[str, Any]]:
        """The next line of each key, in whatever order they come: the SDK's threads say what they get."""
        found: dict[str, dict[str, Any]] = {}
        while len(found) < len(keys):
            line = self.said_any({*keys} - {*found})
            found[next(key for key in keys if key in line and key not in found)] = line
        return [found[key] for key in keys]

    def stop(self, number: int = signal.SIGTERM) -> None:
        """End it by a signal and wait."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            self.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(10.0)

    def close(self) -> None:
        """End it and let go of its pipe."""
        self.stop()
        self._reader.join(10.0)
        assert self.process.stdout is not None
        self.process.stdout.close()
