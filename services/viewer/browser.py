"""The page's server: viser behind our own access check (door.py)."""

from __future__ import annotations

import contextlib
import io
import secrets
import socket
from dataclasses import dataclass
from html import escape
from pathlib import Path

import viser
from viser.infra import ClientId, WebsockClientConnection

from services.viewer.door import PASSPORT, Door, listen
from services.viewer.gate import Gate, is_this_machine, page_answer

BRAND = (28, 98, 156)


class NotThroughTheDoor(Exception):
    """A connection to the page's server that did not come through the door."""


class PageServer(viser.ViserServer):
    """viser behind the door, and without its public tunnel: no click may publish a cell to the internet."""

    def only_with(self, passport: str) -> None:
        """Refuse every connection without this passport, before reading a message of it."""
        behind = self._websock_server
        connections = behind._live_connections

        def check(connection: WebsockClientConnection) -> None:
            request = connections[ClientId(connection.client_id)].request
            brought = "" if request is None else request.headers.get(PASSPORT, "")
            if not secrets.compare_digest(brought, passport):
                raise NotThroughTheDoor

        behind.on_client_connect(check)

    def request_share_url(self, verbose: bool = True) -> None:
        """Always refused."""
        return None


@dataclass(frozen=True, slots=True, eq=False)
class Browser:
    """A page that is served. `address` is the URL to open, with its token; `moved` says why the port is another one."""

    server: PageServer
    door: Door
    address: str
    without_token: str
    moved: str

    def close(self) -> None:
        """Stop serving."""
        self.door.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


def open_browser(host: str, port: int | None, title: str, token: str = "") -> Browser:
    """Open an empty page. Connections from other machines need a token: `token`, or a random one.

    Raises ConfigError where it cannot listen there.
    """
    listening, moved = listen(host, port)
    wanted = token or ("" if is_this_machine(host) else secrets.token_urlsafe(24))
    with contextlib.redirect_stdout(io.StringIO()):  # viser's banner shows the port behind the door
        server = PageServer(host="127.0.0.1", port=_free_port(), label=title, verbose=False)
    passport = secrets.token_urlsafe(24)
    server.only_with(passport)
    html = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text(encoding="utf-8")
    here = listening.getsockname()[1]
    door = Door(listening, Gate(wanted), page_answer(html, escape(title)), server.get_port(), passport)
    server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=BRAND)
    named = socket.gethostname() if host in ("0.0.0.0", "::") else host
    shown = f"[{named}]" if ":" in named else named
    address = f"http://{shown}:{here}/"
    return Browser(server, door, address + (f"?token={wanted}" if wanted else ""), address, moved)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])
