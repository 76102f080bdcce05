"""Peers of devices as processes of their own, on free ports, told what to do by lines."""

from __future__ import annotations

import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from crosspih_common.messages import Severity
from tests.conftest import ROOT

DEADLINE_S = 30.0


class Peer:
    """A peer that serves: its ports by name."""

    def __init__(self, process: subprocess.Popen[str], ports: dict[str, int]) -> None:
        self.process, self.ports = process, ports

    def say(self, line: str) -> None:
        """A command."""
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def feed(self, *wrench: float) -> None:
        """What it feels from now on, N and Nm."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as to:
            to.sendto(struct.pack("<6d", *wrench), ("127.0.0.1", self.ports["feed"]))


@contextmanager
def serving(name: str, *arguments: str) -> Iterator[Peer]:
    """`python -m services.operator.bench.protocols.NAME ...`, ended by its pid."""
    process = subprocess.Popen(
        [sys.executable, "-m", f"services.operator.bench.protocols.{name}", "--feed-port", "0", *arguments],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None and process.stdout is not None
    with process.stdin, process.stdout:
        try:
            words = process.stdout.readline().split()
            assert words[:1] == ["ready"], words
            yield Peer(process, {name: int(port) for name, port in zip(words[1::2], words[2::2], strict=True)})
        finally:
            process.kill()
            process.wait(DEADLINE_S)


class Told:
    """What a driver tells."""

    def __init__(self) -> None:
        self.events: list[tuple[Severity, str, str]] = []

    def __call__(self, severity: Severity, code: str, text: str) -> None:
        self.events.append((severity, code, text))

    def codes(self) -> list[str]:
        return [code for _, code, _ in self.events]

    def last(self, before: str, code: str) -> bool:
        """Whether of two codes the latter was told last."""
        return next((told for told in reversed(self.codes()) if told in (before, code)), None) == code

    def text(self, code: str) -> str:
        return next(text for _, told, text in self.events if told == code)


def wait_until(done: Callable[[], bool], what: str, deadline_s: float = DEADLINE_S) -> float:
    """How long it took."""
    began_s = time.monotonic()
    while not done():
        assert time.monotonic() - began_s < deadline_s, what
        time.sleep(0.002)
    return time.monotonic() - began_s
