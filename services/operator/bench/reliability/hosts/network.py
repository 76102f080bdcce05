"""Simulated hosts on this machine: network namespaces, each with one address, and the switch between them.

It needs Linux, /dev/net/tun and the right to make namespaces (root, or CAP_NET_ADMIN with CAP_SYS_ADMIN). Nothing of
this machine's own network is changed, and all of it is removed afterwards; the next run removes what a killed one left.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

from crosspih_common.errors import CrosspihError
from crosspih_common.modules import module_command

TUN = "/dev/net/tun"
TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
PREFIX = "crosspih"
NAMESPACES = Path("/run/netns")


class NoNetwork(CrosspihError):
    """Hosts cannot be made here; the message gives the reason."""


def _ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NoNetwork(f"ip {' '.join(words)}: {done.stderr.strip() or done.returncode}")


def why_not() -> str:
    """Why no hosts can be made here; empty when they can."""
    if not sys.platform.startswith("linux") or shutil.which("ip") is None:
        return "network namespaces need Linux and the program ip (iproute2)"
    if not os.access(TUN, os.R_OK | os.W_OK):
        return f"{TUN} cannot be opened"
    try:
        with ExitStack() as stack:
            _namespace(stack, "probe")
    except NoNetwork as error:
        return str(error)
    return ""


def _name(host: str) -> str:
    return f"{PREFIX}-{os.getpid()}-{host}"


def _namespace(stack: ExitStack, host: str) -> str:
    name = _name(host)
    _ip("netns", "add", name)
    stack.callback(_ip, "netns", "del", name)
    return name


def _remove_what_was_left() -> None:
    """Remove namespaces of runs whose process is gone."""
    for path in NAMESPACES.glob(f"{PREFIX}-*-*") if NAMESPACES.is_dir() else ():
        pid = path.name.split("-")[1]
        if pid.isdigit() and not Path("/proc", pid).exists():
            subprocess.run(["ip", "netns", "del", path.name], capture_output=True, check=False)


class Network:
    """Hosts by name, each with its IPv4 address, from `with` to its end. Raises NoNetwork."""

    def __init__(self, addresses: Mapping[str, str]) -> None:
        self.addresses = dict(addresses)
        self._stack = ExitStack()
        self._switch: subprocess.Popen[str] | None = None

    def __enter__(self) -> Network:
        try:
            _remove_what_was_left()
            self._make()
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._stack.close()

    def _make(self) -> None:
        ends = {host: self._host(index, host, address) for index, (host, address) in enumerate(self.addresses.items())}
        self._switch = switch = subprocess.Popen(
            [
                *module_command("services.operator.bench.reliability.hosts.switch"),
                *(f"{self.addresses[host]}={fd}" for host, fd in ends.items()),
            ],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, pass_fds=list(ends.values()),
        )  # fmt: skip
        self._stack.callback(_end, switch)
        for fd in ends.values():
            os.close(fd)
        self.become()  # an answer shows that it runs

    def _host(self, index: int, host: str, address: str) -> int:
        """Make the host; returns the file descriptor of its cable's other end."""
        name = _namespace(self._stack, host)
        device = f"cp{os.getpid()}h{index}"
        try:
            fd = os.open(TUN, os.O_RDWR)
            fcntl.ioctl(fd, TUNSETIFF, struct.pack("16sH", device.encode(), IFF_TUN | IFF_NO_PI))
        except OSError as error:
            raise NoNetwork(f"{TUN}: {error.strerror}") from None
        _ip("link", "set", device, "netns", name)
        for words in (("link", "set", "lo", "up"), ("addr", "add", f"{address}/24", "dev", device)):
            _ip("-n", name, *words)
        _ip("-n", name, "link", "set", device, "up")
        return fd

    def on(self, host: str, command: Sequence[str]) -> list[str]:
        """The command that runs this command on that host, under its name."""
        named = ["unshare", "--uts", "sh", "-c", 'hostname "$0" && exec "$@"', host]
        return ["ip", "netns", "exec", _name(host), *named, *command]

    def become(self, delay_s: float = 0.0, loss: float = 0.0, out: Sequence[str] = ()) -> dict[str, int]:
        """From now on each packet takes `delay_s` longer, a share `loss` of them is lost, and the hosts `out` have no
        cable.

        Returns the packets passed, lost and cut so far.
        """
        switch = self._switch
        assert switch is not None and switch.stdin is not None and switch.stdout is not None
        wanted = {"delay_s": delay_s, "loss": loss, "out": [self.addresses[host] for host in out]}
        switch.stdin.write(json.dumps(wanted) + "\n")
        switch.stdin.flush()
        counts: Any = json.loads(switch.stdout.readline() or "{}")
        if not counts:
            raise NoNetwork("the switch between the hosts ended")
        return dict(counts)


def _end(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None and process.stdout is not None
    process.stdin.close()
    process.stdout.close()
    process.wait()
