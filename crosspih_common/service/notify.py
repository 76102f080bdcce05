"""Telling the launcher how this process is: the datagrams of systemd's ``sd_notify(3)``, without libsystemd.

The launcher (or systemd) names a Unix datagram socket in ``NOTIFY_SOCKET``. Without it every function here does
nothing, so that a service started by hand needs no launcher. Standard library only, and no call raises: a launcher
that has gone must not take the service with it.
"""

import os
import socket

_SOCKET = "NOTIFY_SOCKET"
_WATCHDOG_US = "WATCHDOG_USEC"
_WATCHDOG_PID = "WATCHDOG_PID"


def ready() -> bool:
    """Say that the service can be used now: services that wait for it to be healthy start. True if it was sent."""
    return send("READY=1")


def watchdog() -> bool:
    """Say that the service is alive; due at least every :func:`watchdog_period_s`. True if it was sent."""
    return send("WATCHDOG=1")


def status(text: str) -> bool:
    """Say in one line what the service is doing; shown by ``crosspih ps``. True if it was sent."""
    return send("STATUS=" + " ".join(text.split()))


def stopping() -> bool:
    """Say that the service is closing on its own account. True if it was sent."""
    return send("STOPPING=1")


def watchdog_period_s() -> float | None:
    """The longest time in seconds the launcher allows between two :func:`watchdog` calls; None if it does not watch."""
    watched_pid = os.environ.get(_WATCHDOG_PID)
    if watched_pid and watched_pid != str(os.getpid()):
        return None
    try:
        period_s = int(os.environ.get(_WATCHDOG_US, "")) * 1e-6
    except ValueError:
        return None
    return period_s if period_s > 0.0 else None


def send(state: str) -> bool:
    """Send one notification (newline-separated ``KEY=value``) and return True if the launcher's socket took it.

    ``NOTIFY_SOCKET`` is a path, or ``@name`` for a Linux abstract socket. The send never blocks: a launcher that does
    not read loses the message, not the service its time.
    """
    address = os.environ.get(_SOCKET, "")
    if address.startswith("@"):
        address = "\0" + address[1:]
    elif not address.startswith("/"):
        return False
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
            channel.setblocking(False)
            channel.sendto(state.encode(), address)
    except OSError:
        return False
    return True
