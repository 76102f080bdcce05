"""The stack split over hosts by the one compose file: on each host `crosspih up` with the services of that host."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from crosspih_common.errors import CrosspihError, NoService
from crosspih_common.keys import CAMERA_ALIVE
from crosspih_common.modules import module_command
from crosspih_common.security import CERTIFICATES, Credentials
from crosspih_common.security.access import SERVICES
from services.operator.bench.reliability.hosts.network import Network
from services.operator.security.issuing import issue_all

LOOPBACK = "127.0.0.1"
LOCAL_ENDPOINT = f"tcp/{LOOPBACK}:7447"  # address of each host's own router, for the services on it
PORT = 7448  # for other hosts' routers
UP_S = 180.0
CLOCK_AHEAD = Path(__file__).with_name("clock_ahead.c")


@dataclass(frozen=True)
class Host:
    """One machine: its address, its services, and how far its wall clock is ahead of the others'."""

    name: str
    address: str
    services: tuple[str, ...]
    connects_to: tuple[str, ...] = ()  # routers of these hosts
    clock_ahead_s: float = 0.0


CELL = Host("cell", "10.77.0.1", ("router", "hardware", "force_torque"))
COMPUTE = Host("compute", "10.77.0.2", ("router", "vision", "inference", "planning"), ("cell",))
# Both connect to the cell, and not to each other: docs/several-machines.md says why.
RECORDER = Host("recorder", "10.77.0.3", ("router", "recorder"), ("cell",))
THREE = (CELL, COMPUTE, RECORDER)
ONE = (Host("alone", "10.77.0.1", tuple(dict.fromkeys(name for host in THREE for name in host.services))),)


class Stacks:
    """Runs commands on hosts, each with its own folder."""

    def __init__(self, network: Network, hosts: Sequence[Host], folder: Path, cell: Path, speed: str) -> None:
        self._network, self._hosts, self._folder = network, {host.name: host for host in hosts}, folder
        self._cell, self._speed = cell, speed
        self._certificates: dict[str, Path] = {}

    def issue_certificates(self) -> None:
        """One authority; each host gets the certificates of its own services and of its operators."""
        everything = self._folder / "certificates"
        issue_all(everything, SERVICES, [LOOPBACK, *(host.address for host in self._hosts.values())], days=1.0)
        for host in self._hosts.values():
            own = self.folder(host.name) / "certificates"
            own.mkdir(mode=0o700)
            needed = {"operator", *host.services} | ({CAMERA_ALIVE} if "hardware" in host.services else set())
            files = [Credentials(everything, service) for service in sorted(needed & set(SERVICES))]
            for file in {files[0].authority, *(one.certificate for one in files), *(one.key for one in files)}:
                shutil.copy2(file, own)
            self._certificates[host.name] = own

    def folder(self, host: str) -> Path:
        """The folder in which this host's services write."""
        path = self._folder / host
        path.mkdir(exist_ok=True)
        return path

    def environment(self, host: Host) -> dict[str, str]:
        """The environment that a user would set there before `crosspih up`."""
        told = {
            **os.environ,
            "CROSSPIH_CELL": str(self._cell),
            "CROSSPIH_SPEED": self._speed,
            "CROSSPIH_ENDPOINT": LOCAL_ENDPOINT,
            "CROSSPIH_ROUTER_LISTEN": f"tcp/{host.address}:{PORT}" if len(self._hosts) > 1 else "",
            "CROSSPIH_ROUTERS": ",".join(f"tcp/{self._hosts[name].address}:{PORT}" for name in host.connects_to),
            "CROSSPIH_RUN_DIR": str(self.folder(host.name) / "run"),
            "CROSSPIH_DATA": str(self.folder(host.name)),
            CERTIFICATES: str(self._certificates[host.name]) if host.name in self._certificates else "",
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
        """Start `python -m <words>` on that host; the caller waits for it."""
        return subprocess.Popen(
            self._network.on(host, module_command(*words)),
            env=self.environment(self._hosts[host]), cwd=self.folder(host),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def run(self, host: str, *words: str) -> subprocess.CompletedProcess[str]:
        """As `start`, and wait for its end."""
        process = self.start(host, *words)
        out, err = process.communicate()
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    def crosspih(self, host: str, *words: str) -> subprocess.CompletedProcess[str]:
        """`crosspih <words>` on that host."""
        return self.run(host, "services.operator", *words)

    def logs(self, host: str) -> str:
        """The logs of its services."""
        return self.crosspih(host, "logs").stdout

    def _down(self, host: str) -> None:
        with contextlib.suppress(OSError):
            self.crosspih(host, "down")


@contextmanager
def stacks_up(
    network: Network, hosts: Sequence[Host], folder: Path, cell: Path, speed: str, secure: bool = False
) -> Iterator[Stacks]:
    """`crosspih up` on every host at once, and `crosspih down` at the end. `secure`: every link is mTLS. Raises
    NoService.
    """
    stacks = Stacks(network, hosts, folder, cell, speed)
    if secure:
        stacks.issue_certificates()
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
