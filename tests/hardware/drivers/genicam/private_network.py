"""A network of the test's own, with addresses for two cameras that can be unplugged. Needs root on Linux, and `ip`."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from crosspih_common.aravis import load
from crosspih_common.errors import ConfigError

CLONE_NEWNET = 0x40000000
LEFT, RIGHT, THIRD, FOURTH = ADDRESSES = "127.0.0.2", "127.0.0.3", "127.0.0.4", "127.0.0.5"
FAKE_CAMERA = "arv-fake-gv-camera-0.8"


@contextmanager
def private_network() -> Iterator[None]:
    """This thread, and all that it starts, in a network namespace whose loopback has the cameras' addresses.

    Skips the test where that cannot be had.
    """
    if shutil.which("ip") is None or not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("two cameras on one machine need two addresses: a network namespace, as root, and iproute2")
    libc = ctypes.CDLL(None, use_errno=True)
    with Path(f"/proc/self/task/{threading.get_native_id()}/ns/net").open("rb") as own:
        if libc.unshare(CLONE_NEWNET) != 0:
            pytest.skip(f"no network namespace: {os.strerror(ctypes.get_errno())}")
        try:
            for words in (
                ("link", "set", "lo", "up"),
                *(("addr", "add", f"{address}/8", "dev", "lo") for address in ADDRESSES),
            ):
                subprocess.run(["ip", *words], check=True)
            yield
        finally:
            assert libc.setns(own.fileno(), CLONE_NEWNET) == 0, os.strerror(ctypes.get_errno())


@contextmanager
def camera_network() -> Iterator[None]:
    """`private_network`; skips the test also where aravis' library is not there."""
    try:
        load()
    except ConfigError as error:
        pytest.skip(str(error))
    with private_network():
        yield


class FakeCamera:
    """Debian's fake camera as a process of its own; `silent` and `heard_again` are its cable out and in."""

    def __init__(self, address: str, serial: str, *options: str) -> None:
        self._command = [FAKE_CAMERA, "-i", address, "-s", serial, *options]
        self.process = subprocess.Popen(self._command)

    def kill(self) -> None:
        """As when its power goes."""
        self.process.kill()
        self.process.wait(10)

    def start_again(self) -> None:
        """As when its power comes back: it remembers nothing."""
        self.process = subprocess.Popen(self._command)
