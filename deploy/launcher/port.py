"""Whether the router's port is free, asked before anything is started: a router that cannot listen would be started
again and again, and the other services would wait for it."""

import os
import socket

from crosspih_common.endpoints import ENDPOINT_VARIABLE, EXAMPLE, checked, parsed
from deploy.launcher.errors import StartError

CONNECT_S = 0.5


def require_free_port(endpoint: str | None = None) -> None:
    """Raise StartError where somebody listens already where the router of a new stack would; ConfigError where the
    endpoint is none. One on another machine is that machine's affair."""
    where = checked(endpoint or os.environ.get(ENDPOINT_VARIABLE) or EXAMPLE)
    found = parsed(where)
    if found is None or not found.here or found.kind == "udp":
        return
    host = "127.0.0.1" if found.host == "0.0.0.0" else found.host
    try:
        with socket.create_connection((host, found.port), timeout=CONNECT_S):
            pass
    except OSError:
        return
    raise StartError(
        f"{where} is in use: another stack, or another program, listens there; end it (crosspih ps, crosspih down), or "
        f"name another port: {ENDPOINT_VARIABLE}={found.kind}/{found.host}:{found.port + 1}"
    )
