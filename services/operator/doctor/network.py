"""The endpoint: which process has it, whether a router answers there, and which services run behind it."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.endpoints import EXAMPLE, parsed
from crosspih_common.errors import BusError, ConfigError
from crosspih_common.holding.soundness import TICKS_KEPT, boots
from crosspih_common.keys import CLOCK
from crosspih_common.service.wall_clock import APART_S, measured
from services.operator.cli.rows import Row, ok, warning, wrong

CONNECT_S = 1.0
HEAR_S = 1.0


def listens(host: str, port: int, wait_s: float = CONNECT_S) -> bool:
    """Whether something accepts a TCP connection."""
    try:
        with socket.create_connection((host, port), wait_s):
            return True
    except OSError:
        return False


def occupant(port: int) -> str:
    """The process that listens on a TCP port of this machine; empty where it cannot be seen (not Linux, or another
    user's).
    """
    inodes = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        try:
            lines = Path(table).read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            parts = line.split()
            if parts[3] == "0A" and int(parts[1].rpartition(":")[2], 16) == port:
                inodes.add(f"socket:[{parts[9]}]")
    for process in Path("/proc").glob("[0-9]*") if inodes else ():
        try:
            if any(os.readlink(link) in inodes for link in (process / "fd").iterdir()):
                words = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
                return f"pid {process.name} ({words[:80]})"
        except OSError:
            continue
    return ""


def router_rows(endpoint: str, cell: str) -> tuple[list[Row], Bus | None]:
    """The rows, and a bus where a router answers: the caller closes it."""
    name = "router"
    at = parsed(endpoint)
    if at is None:
        mend = f"write CROSSPIH_ENDPOINT as {EXAMPLE}"
        return [wrong(name, f"CROSSPIH_ENDPOINT {endpoint!r} is no address", mend)], None
    if at.kind in ("tcp", "tls", "ws") and not listens(at.host, at.port):
        if at.here:
            return [ok(name, f"{endpoint} is free: a stack would start its router there")], None
        mend = "start the router there, or unset CROSSPIH_ENDPOINT for one on this machine"
        return [wrong(name, f"nothing answers at {endpoint}", mend)], None
    try:
        bus = Bus(open_zenoh(endpoint, CONNECT_S), cell, "operator")
    except ConfigError as error:
        return [wrong(name, str(error), "crosspih security show")], None
    except BusError:
        by = (occupant(at.port) if at.here else "") or "something else"
        mend = f"end it, or take another port: CROSSPIH_ENDPOINT=tcp/127.0.0.1:{at.port + 1}"
        return [wrong(name, f"{endpoint} is taken by {by}, which is no Zenoh router", mend)], None
    by = occupant(at.port) if at.here else ""
    return [ok(name, f"a router answers at {endpoint}" + (f": {by}" if by else ""))], bus


def cells_clock_rows(bus: Bus) -> Iterator[Row]:
    """How far the wall clock here is from that of the cell's machine."""
    name, wall = "wall clock of the cell", measured(bus)
    if wall is None:
        yield ok(name, "the cell does not tell its wall clock")
    elif wall.least_s > APART_S:
        mend = "set both by NTP (chrony): log times of recordings and logs differ by that, stamps do not"
        yield warning(name, str(wall), mend)
    else:
        yield ok(name, str(wall))


def service_rows(bus: Bus, alive: set[str], needed: tuple[str, ...]) -> Iterator[Row]:
    """Behind a router: which services run, and whether there is only one cell on these keys."""
    missing = [name for name in needed if name not in alive]
    if not alive:
        yield ok("services", f"none of the cell {bus.cell} runs; a command that needs them starts them")
        return
    if missing:
        logs = f"crosspih logs {' '.join(missing)}"
        mend = f"{logs} says why; start what is missing, or stop the rest with crosspih down and start anew"
        yield wrong("services", f"{', '.join(sorted(alive))} live, {', '.join(missing)} not", mend)
    else:
        yield ok("services", f"{', '.join(sorted(alive))} live")
    with bus.reading(CLOCK, TICKS_KEPT) as clock:
        clock.wait_for(lambda _: len(boots(clock.values())) > 1, HEAR_S)
        heard = boots(clock.values())
    if len(heard) > 1:
        mend = "stop one of them, or give it another cell.name"
        yield wrong("one cell on its keys", f"{len(heard)} cells tick on the keys of {bus.cell}", mend)
    elif not heard and "hardware" in alive:
        yield wrong("one cell on its keys", "hardware lives and does not tick", "crosspih logs hardware; start it anew")
    elif heard:
        yield ok("one cell on its keys", f"one clock ticks, boot id {heard[0]}")
