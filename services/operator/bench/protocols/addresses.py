"""Addresses for devices on loopback: two cameras on one machine need one address each."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from pathlib import Path

from crosspih_common.errors import ConfigError

_NEW_USER, _NEW_NETWORK = 0x10000000, 0x40000000


def private_network(addresses: tuple[str, ...]) -> None:
    """Put this process, and all that it starts from now on, into its own network namespace, whose loopback has these
    addresses besides 127.0.0.1. This cannot be undone. Call it before any thread is started.

    Raises ConfigError where the machine does not allow it (Linux, root or unprivileged user namespaces, iproute2).
    """
    if shutil.which("ip") is None:
        raise ConfigError("two cameras on one machine need two addresses: install iproute2 (the command `ip`)")
    libc = ctypes.CDLL(None, use_errno=True)
    if not hasattr(libc, "unshare"):
        raise ConfigError("two cameras on one machine need network namespaces, which Linux alone has")
    user, group = os.geteuid(), os.getegid()
    if libc.unshare(_NEW_NETWORK if user == 0 else _NEW_USER | _NEW_NETWORK) != 0:
        raise ConfigError(f"no network namespace ({os.strerror(ctypes.get_errno())}): run it as root")
    if user != 0:  # the user who started it is root in the namespace
        Path("/proc/self/setgroups").write_text("deny", encoding="ascii")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1", encoding="ascii")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1", encoding="ascii")
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    for address in addresses:
        subprocess.run(["ip", "addr", "add", f"{address}/24", "dev", "lo"], check=True)
