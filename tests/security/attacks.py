"""What the tests of attacks share: a router with certificates, services beside it, and intruders."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, TypeVar

import zenoh

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.bus.codec import encode, label_with_seq
from crosspih_common.keys import EVENTS, Command
from crosspih_common.messages import Event, Message
from crosspih_common.security import Credentials
from tests.conftest import ServiceProcess

CELL = "secured"
DEADLINE_S = 120.0  # a service reads its imports for half a minute beside twenty busy processes
REFUSED_S = 1.5  # an intruder's own patience
RequestT = TypeVar("RequestT", bound=Message)


class Secured:
    """A router that asks for certificates, force_torque behind it, and an operator who hears every event."""

    def __init__(self, folder: Path, cell_file: Path, router: ServiceProcess, endpoint: str) -> None:
        self.folder, self.cell_file, self.router, self.endpoint = folder, cell_file, router, endpoint
        self.told: list[str] = []  # the events of the test under way
        self.operator = self.bus("operator")
        self._events = self.operator.latest(EVENTS, 256)
        self.force_torque = self.start("force_torque")

    def start(self, service: str) -> ServiceProcess:
        """`python -m services.<service>` with its own certificate."""
        return ServiceProcess(service, "--cell", str(self.cell_file), "--endpoint", self.endpoint)

    def bus(self, service: str) -> Bus:
        """A place on the bus with a service's own certificate."""
        return Bus(open_zenoh(self.endpoint, DEADLINE_S, service), CELL, service)

    def event(self, code: str, *words: str) -> Event:
        """The event of a code that holds all words, waiting for it."""
        found = self._events.wait_for(
            lambda event: event.code == code and all(word in event.text for word in words), DEADLINE_S
        )
        self.told.append(f"{found.service} {code}: {found.text}" if found is not None else "nothing")
        assert found is not None, (code, words, [(event.code, event.text) for event in self._events.values()])
        return found

    def intruder(self, credentials: Credentials | None, **settings: Any) -> zenoh.Config:
        """The configuration of somebody who makes his own, and believes every router."""
        config = zenoh.Config()
        settings = {
            "mode": "client",
            "connect/endpoints": [self.endpoint.replace("tcp/", "tls/")],
            "connect/timeout_ms": int(REFUSED_S * 1000),
            "connect/exit_on_failure": True,
            "scouting/multicast/enabled": False,
            "transport/link/tls/root_ca_certificate": str(self.folder / "ca.pem"),
            **settings,
        }
        if credentials is not None:
            settings["transport/link/tls/enable_mtls"] = True
            settings["transport/link/tls/connect_certificate"] = str(credentials.certificate)
            settings["transport/link/tls/connect_private_key"] = str(credentials.key)
        for name, value in settings.items():
            config.insert_json5(name, json.dumps(value))
        return config

    def stays_out(self, credentials: Credentials | None) -> bool:
        """Whether the router lets nobody in with these."""
        try:
            zenoh.open(self.intruder(credentials)).close()
        except zenoh.ZError:
            return True
        return False

    def close(self) -> None:
        """End what was started."""
        self.operator.close()
        self.force_torque.terminate()
        self.router.terminate()


def asked_outright(bus: Bus, command: Command[RequestT, Any], request: RequestT, deadline_s: float = 2.0) -> None:
    """Ask without a look at who serves the command, as `Bus.call` does not: the router tells this name of nobody.
    Raises BusError when it is not answered."""
    bus._transport.query(command.key(CELL), encode(request), label_with_seq(command.request, 0), deadline_s)


def listening_ports(pid: int) -> set[int]:
    """The TCP ports on which a process listens: its sockets, found in the kernel's tables."""
    own = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        target = os.readlink(entry)
        if target.startswith("socket:["):
            own.add(target[8:-1])
    ports = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and fields[9] in own:  # 0A: LISTEN
                ports.add(int(fields[1].rpartition(":")[2], 16))
    return ports
