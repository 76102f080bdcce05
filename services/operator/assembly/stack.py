"""The stack that a command needs: the running one, or a separate one that is stopped at the end."""

from __future__ import annotations

import contextlib
import os
import socket
import uuid
from collections.abc import Iterator
from contextlib import contextmanager

from crosspih_common.config import load_cell
from crosspih_common.errors import BusUnreachable, ConfigError, CrosspihError
from crosspih_common.security import CERTIFICATES
from deploy.launcher import DEFAULT_PROJECT, StackRequest, is_up, start_stack, stop_stack
from deploy.launcher.port import require_free_port
from services.operator.assembly.session import NEEDED, Session
from services.operator.bench.cells.stopping import stopped_in_order
from services.operator.cell.which_cell import cell_path, endpoint

START_DEADLINE_S = 90.0
LOOK_S = 2.0  # for a router that is already there


def refused_at_once(where: str) -> bool:
    """Whether this machine refuses a connection there at once. Otherwise a command would wait about a second for a
    router that is not there before it starts a stack.
    """
    protocol, _, address = where.partition("/")
    host, _, port = address.partition("?")[0].partition("#")[0].rpartition(":")
    if protocol != "tcp" or not port.isdigit() or os.environ.get(CERTIFICATES):
        return False
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=1.0):
            return False
    except ConnectionRefusedError:
        return True
    except OSError:
        return False


@contextmanager
def running_session(needed: tuple[str, ...], deadline_s: float) -> Iterator[Session]:
    """A session on the running stack, for commands that make no sense in one that has just been started.

    Raises BusUnreachable where none runs, and a CrosspihError when a needed service is not there by the deadline.
    """
    load_cell(cell_path())
    if refused_at_once(where := endpoint()):
        raise BusUnreachable(
            f"no stack runs at {where}; start it with `crosspih up`, or name another with CROSSPIH_ENDPOINT"
        )
    with Session(connect_timeout_s=LOOK_S) as session:
        session.wait_for_services(deadline_s, needed)
        yield session


@contextmanager
def cell_session(speed: str | None, needed: tuple[str, ...] = (*NEEDED, "recorder")) -> Iterator[tuple[Session, bool]]:
    """A session on the running stack, or on one started for it; yields (session, whether it was started here).

    `speed` is "realtime" or "max". A running stack keeps its own speed: asking for the other one is an error.
    """
    session = None
    load_cell(cell_path())  # report errors in the file before anything is started
    if not refused_at_once(endpoint()):
        with contextlib.suppress(BusUnreachable):
            session = Session(connect_timeout_s=1.0)
    if session is not None:
        with session:
            session.wait_for_services(START_DEADLINE_S, needed)
            session.require_sound_cell()
            running = session.speed()
            if speed is not None and running != speed:
                raise ConfigError(
                    f"--speed {speed}: the running stack is at {running}; stop it with `crosspih down`, or leave "
                    f"--speed out"
                )
            yield session, False
        return
    require_free_port(endpoint())
    project = DEFAULT_PROJECT
    if is_up(project):
        project = f"{DEFAULT_PROJECT}-{uuid.uuid4().hex[:6]}"
    if speed is not None:
        os.environ["CROSSPIH_SPEED"] = speed
    request = StackRequest(project=project)
    with stopped_in_order():
        start_stack(request, True, START_DEADLINE_S, on_change=lambda line: None)
        try:
            with Session() as session:
                session.wait_for_services(START_DEADLINE_S, needed)
                session.require_sound_cell()
                yield session, True
        finally:
            # if the stack is already gone nothing is left to stop
            with contextlib.suppress(CrosspihError):
                stop_stack(project)
