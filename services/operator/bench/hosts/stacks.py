"""The stack split over hosts by the one compose file: on each host `crosspih up` with the services that run there."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import deploy
from crosspih_common.errors import CrosspihError, NoService
from services.operator.bench.hosts.network import Network

LOCAL_ENDPOINT = "tcp/127.0.0.1:7447"  # of each host's own router, for the services on it
PORT = 7448  # for other hosts' routers
UP_S = 180.0
ROOT = Path(deploy.__file__).resolve().parent.parent
CLOCK_AHEAD = Path(__file__).with_name("clock_ahead.c")


@dataclass(frozen=True)
class Host:
    """One machine: its address, what runs on it, and how far its wall clock is ahead of the others'."""

    name: str
    address: str
    services: tuple[str, ...]
    connects_to: tuple[str, ...] = ()  # routers of these hosts
    clock_ahead_s: float = 0.0
    environment: dict[str, str] = field(default_factory=dict)


CELL = Host("cell", "10.77.0.1", ("router", "hardware", "force_torque"))
COMPUTE = Host("compute", "10.77.0.2", ("router", "vision", "inference", "planning"), ("cell",))
RECORDER = Host("recorder", "10.77.0.3", ("router", "recorder"), ("cell", "compute"))
THREE = (CELL, COMPUTE, RECORDER)
ONE = (Host("alone", "10.77.0.1", tuple(dict.fromkeys(name for host in THREE for name in host.services))),)


class Stacks:
    """Runs commands on hosts, each with its own folder."""

    def __init__(self, network: Network, hosts: Sequence[Host], folder: Path, cell: Path, speed: str) -> None:
        self._network, self._hosts, self._folder = network, {host.name: host for host in hosts}, folder
        self._cell, self._speed = cell, speed

    def folder(self, host: str) -> Path:
        """Where what this host's services write is."""
        path = self._folder / host
        path.mkdir(exist_ok=True)
        return path

    def environment(self, host: Host) -> dict[str, str]:
        """What a user would set there before `crosspih up`."""
        told = {
            **os.environ,
            "CROSSPIH_CELL": str(self._cell),
            "CROSSPIH_SPEED": self._speed,
            "CROSSPIH_ENDPOINT": LOCAL_ENDPOINT,
            "CROSSPIH_ROUTER_LISTEN": f"tcp/{host.address}:{PORT}" if len(self._hosts) > 1 else "",
            "CROSSPIH_ROUTERS": ",".join(f"tcp/{self._hosts[name].address}:{PORT}" for name in host.connects_to),
            "CROSSPIH_RUN_DIR": str(self.folder(host.name) / "run"),
            "CROSSPIH_DATA": str(self.folder(host.name)),
            "PYTHONPATH": str(ROOT),
            **host.environment,
        }
        if host.clock_ahead_s:
            told |= {"LD_PRELOAD": str(self._shifted()), "CLOCK_AHEAD_NS": str(round(host.clock_ahead_s * 1e9))}
        return told

    def _shifted(self) -> Path:
        """The library that shifts a wall clock. Raises CrosspihError without a C compiler."""
        library = self._folder / "clock_ahead.so"
        if not library.exists():
            compiler = shutil.which("cc")
            if compiler is None:
                raise CrosspihError("a host whose clock is off needs a C compiler (cc)")
            words = [compiler, "-shared", "-fPIC", "-O1", "-o", str(library), str(CLOCK_AHEAD), "-ldl"]
            subprocess.run(words, check=True)
        return library

    def start(self, host: str, *words: str) -> subprocess.Popen[str]:
        """`python -m <words>` on that host; whoever starts it waits for it."""
        return subprocess.Popen(
            self._network.on(host, [sys.executable, "-m", *words]),
            env=self.environment(self._hosts[host]), cwd=self.folder(host),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def run(self, host: str, *words: str) -> subprocess.CompletedProcess[str]:
        """As `start`, to its end."""
        process = self.start(host, *words)
        out, err = process.communicate()
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    def crosspih(self, host: str, *words: str) -> subprocess.CompletedProcess[str]:
        """`crosspih <words>` on that host."""
        return self.run(host, "services.operator", *words)

    def logs(self, host: str) -> str:
        """What its services wrote."""
        return self.crosspih(host, "logs").stdout

    def _down(self, host: str) -> None:
        with contextlib.suppress(OSError):
            self.crosspih(host, "down")


@contextmanager
def stacks_up(network: Network, hosts: Sequence[Host], folder: Path, cell: Path, speed: str) -> Iterator[Stacks]:
    """`crosspih up` on every host at once, and `crosspih down` in the end. Raises NoService."""
    stacks = Stacks(network, hosts, folder, cell, speed)
    with ExitStack() as undo:
        begun = []
        for host in hosts:
            undo.callback(stacks._down, host.name)
            words = ("up", "--detach", "--wait", "--wait-timeout", f"{UP_S:g}", *host.services)
            begun.append((host, stacks.start(host.name, "services.operator", *words)))
        for host, process in begun:
            said, wrong = process.communicate()
            if process.returncode:
                raise NoService(f"{host.name}: {wrong or said}")
        yield stacks
