"""Whether each service to be started has its certificate: a folder made by an older version lacks those added since."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from crosspih_common.security import CERTIFICATES
from deploy.launcher.compose import Service
from deploy.launcher.errors import LauncherError


def require_certificates(services: Mapping[str, Service]) -> None:
    """Of the services whose environment names a folder of certificates. Raises LauncherError: who has none, and the
    command that makes them."""
    lacking: dict[str, list[str]] = {}
    for name, service in services.items():
        folder = service.environment.get(CERTIFICATES)
        if folder and not all((Path(folder) / f"{name}.{kind}").is_file() for kind in ("pem", "key")):
            lacking.setdefault(folder, []).append(name)
    for folder, names in lacking.items():
        raise LauncherError(
            f"{CERTIFICATES}: {folder} has no certificate and key for {', '.join(names)}: made by an older version? "
            f"`crosspih security init --folder {folder} --overwrite` makes all anew (with the --host of before)"
        )
