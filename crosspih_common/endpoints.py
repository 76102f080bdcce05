"""Parses the address of a router, such as `tcp/127.0.0.1:7447`. Cheap to import, because the launcher needs it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from crosspih_common.errors import ConfigError

ENDPOINT_VARIABLE = "CROSSPIH_ENDPOINT"
EXAMPLE = "tcp/127.0.0.1:7447"
# what may follow the port is Zenoh's own: ?metadata and #configuration, such as tcp/0.0.0.0:7448#iface=eth0
_ENDPOINT = re.compile(
    r"(?P<kind>tcp|tls|ws|quic|udp)/(?P<host>\[[0-9A-Fa-f:.%\w]+\]|[^\s:/\[\]?#]+):(?P<port>[0-9]{1,5})([?#]\S*)?"
)
HERE = ("127.", "::1", "localhost", "0.0.0.0")


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A router's address."""

    kind: str
    host: str
    port: int

    @property
    def here(self) -> bool:
        """Whether it is on this machine."""
        return self.host.startswith(HERE)


def parsed(endpoint: str) -> Endpoint | None:
    """The parsed address; None if the text is no address."""
    found = _ENDPOINT.fullmatch(endpoint)
    if found is None or not 0 < int(found["port"]) < 65536:
        return None
    return Endpoint(found["kind"], found["host"].strip("[]"), int(found["port"]))


def fault_of(endpoint: str) -> tuple[str, str]:
    """(what is wrong, what to write instead) for an invalid address; two empty texts for a valid one."""
    if parsed(endpoint) is not None:
        return "", ""
    return f"{endpoint[:200]!r} is no address of a router", f"write PROTOCOL/HOST:PORT, such as {EXAMPLE}"


def checked(endpoint: str, field: str = ENDPOINT_VARIABLE) -> str:
    """The endpoint, unchanged. Raises ConfigError with the name of its field if it is no address."""
    problem, mend = fault_of(endpoint)
    if problem:
        raise ConfigError(f"{field}: {problem}; {mend}", field=field, mend=mend)
    return endpoint
