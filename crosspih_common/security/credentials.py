"""The paths of a service's certificate and key, for Zenoh's configuration; their contents are never read here."""

from __future__ import annotations

import ipaddress
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crosspih_common.errors import ConfigError

CERTIFICATES = "CROSSPIH_CERTIFICATES"  # the folder; without it the bus is plain TCP
AUTHORITY = "ca.pem"
OTHERS_MAY = stat.S_IRWXG | stat.S_IRWXO


@dataclass(frozen=True, slots=True)
class Credentials:
    """The files of one service below a folder that `crosspih security init` made."""

    folder: Path
    service: str

    @property
    def authority(self) -> Path:
        """The certificate of the authority that signed all others."""
        return self.folder / AUTHORITY

    @property
    def certificate(self) -> Path:
        """The service's certificate, its name as the common name."""
        return self.folder / f"{self.service}.pem"

    @property
    def key(self) -> Path:
        """The service's private key, readable by its owner alone."""
        return self.folder / f"{self.service}.key"

    def check(self) -> None:
        """Raises ConfigError where a file is missing, or where others than its owner may read a key."""
        for file in (self.authority, self.certificate, self.key):
            if not file.is_file():
                raise ConfigError(
                    f"{CERTIFICATES}: {file} is not there; `crosspih security init --folder {self.folder}` makes it, "
                    f"`crosspih security show --folder {self.folder}` tells what there is"
                )
        if self.key.stat().st_mode & OTHERS_MAY:
            raise ConfigError(f"{CERTIFICATES}: others may read {self.key}; `chmod 600` it, or make new ones")

    def listening(self) -> dict[str, Any]:
        """Zenoh's settings of a router that accepts only clients with a certificate of this authority."""
        return self._tls(
            listen_certificate=str(self.certificate), listen_private_key=str(self.key), enable_mtls=True
        )  # fmt: skip

    def connecting(self) -> dict[str, Any]:
        """Zenoh's settings of a client that shows its own certificate, and checks the router's."""
        return self._tls(
            connect_certificate=str(self.certificate),
            connect_private_key=str(self.key),
            enable_mtls=True,
            verify_name_on_connect=True,
        )

    def _tls(self, **settings: Any) -> dict[str, Any]:
        everything = {"root_ca_certificate": str(self.authority), "close_link_on_expiration": True, **settings}
        return {f"transport/link/tls/{name}": value for name, value in everything.items()}


def credentials_from_environment(service: str, endpoint: str) -> Credentials | None:
    """Those that CROSSPIH_CERTIFICATES names; None without it.

    Raises ConfigError where they cannot be used, and where the endpoint is one of TLS and there are none.
    """
    if not (folder := os.environ.get(CERTIFICATES)):
        if endpoint.startswith("tls/"):
            raise ConfigError(
                f"CROSSPIH_ENDPOINT: {endpoint} is reached with a certificate alone; set {CERTIFICATES} to the folder "
                "that `crosspih security init` made, or give the endpoint as tcp/..."
            )
        return None
    found = Credentials(Path(folder).resolve(), service)
    found.check()
    return found


def secure_endpoint(endpoint: str) -> str:
    """The same address by TLS."""
    protocol, slash, where = endpoint.partition("/")
    return f"tls/{where}" if protocol == "tcp" and slash else endpoint


def open_to_whom(endpoint: str) -> str:
    """A warning of a stack without certificates about who can connect; empty if certificates are required."""
    if os.environ.get(CERTIFICATES):
        return ""
    host = endpoint.partition("/")[2].rpartition(":")[0].strip("[]")
    try:
        near = ipaddress.ip_address(host).is_loopback
    except ValueError:
        near = host == "localhost"
    who = "anyone on this machine" if near else f"anyone who reaches {host or 'it'}"
    return f"no {CERTIFICATES}: {who} can command this cell (docs/security.md)"
