"""The addresses of devices in a cell's file, and whether something answers there. Nothing is moved."""

from __future__ import annotations

import errno
import ipaddress
import re
import shutil
import socket
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from services.operator.cli.rows import Row, ok, warning, wrong

# sections of `hardware` without an address
OTHERS = ("simulated", "recorded", "pictures", "limits", "driver", "drivers", "devices", "engine")
HOSTS = ("host", "address", "ip", "robot", "robot_ip", "hostname", "controller", "sensor")
HOST_PORT = re.compile(r"(?:(?:tcp|udp)/)?(?P<host>[A-Za-z0-9.-]+):(?P<port>\d{1,5})")
USUAL_PORTS = (80, 22, 7)  # a refused connection shows a host as well as an accepted one
WAIT_S = 1.0


@dataclass(frozen=True, slots=True)
class Address:
    """A setting with an address; `port` is None where it names none."""

    setting: str
    host: str
    port: int | None


def addresses(hardware: dict[str, Any]) -> tuple[list[Address], list[tuple[str, str]]]:
    """The network addresses and the (setting, file) of device files in the section `hardware`."""
    hosts: list[Address] = []
    files: list[tuple[str, str]] = []
    for name, section in hardware.items():
        if name not in OTHERS and isinstance(section, dict):
            _walk(section, f"hardware.{name}", hosts, files)
    return hosts, files


def _walk(section: dict[str, Any], where: str, hosts: list[Address], files: list[tuple[str, str]]) -> None:
    for name, value in section.items():
        setting = f"{where}.{name}"
        if isinstance(value, dict):
            _walk(value, setting, hosts, files)
        for text in value if isinstance(value, list) else [value]:
            if not isinstance(text, str):
                continue
            if text.startswith("/dev/"):
                files.append((setting, text))
            elif (found := HOST_PORT.fullmatch(text)) and "." in found["host"] + "." * text.startswith("localhost"):
                hosts.append(Address(setting, found["host"], int(found["port"])))
            elif _is_ip(text) or (name in HOSTS and text):
                port = section.get("port")
                hosts.append(Address(setting, text, port if isinstance(port, int) else None))


def _is_ip(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def address_row(address: Address) -> Row:
    """Whether a host answers: by an open port, a refused connection, or an echo."""
    name = f"{address.setting} {address.host}"
    try:
        socket.getaddrinfo(address.host, None)
    except OSError as error:
        return wrong(name, f"no such name ({error.strerror or error})", f"mend {address.setting}, or /etc/hosts")
    ports = (address.port,) if address.port else USUAL_PORTS
    for port in ports:
        said = _knock(address.host, port)
        if said == "open":
            return ok(name, f"answers, TCP port {port} is open")
        if said == "refused":
            if address.port is None:
                return ok(name, "answers")
            return warning(
                name, f"the host answers, but nothing listens on its TCP port {port}",
                f"right for a device that speaks UDP; else start its program, or mend {address.setting}",
            )  # fmt: skip
    if _echoes(address.host):
        return ok(name, "answers to an echo")
    return wrong(name, "does not answer", "is it switched on, its cable in, and this machine in its network?")


def address_rows(hosts: list[Address]) -> Iterator[Row]:
    """All."""
    return (address_row(address) for address in hosts)


def _knock(host: str, port: int) -> str:
    try:
        with socket.create_connection((host, port), WAIT_S):
            return "open"
    except OSError as error:
        return "refused" if error.errno == errno.ECONNREFUSED else "silent"


def _echoes(host: str) -> bool:
    ping = shutil.which("ping")
    if ping is None:
        return False
    done = subprocess.run([ping, "-c", "1", "-W", "1", host], capture_output=True, check=False, timeout=10)
    return done.returncode == 0
