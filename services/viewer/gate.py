"""Who may open the page, decided from the first lines of a connection; allowed connections are passed on unchanged.

Every connection is one HTTP request or one WebSocket, and the page's own server does no authentication. So the door
stands before it. It lets in a client that addresses this machine by its own name or, where the page can be reached from
elsewhere, a client with the token. It lets in only WebSockets that a page from here has opened (a browser says so in
`Origin`), so that another site's page in the same browser cannot press this page's buttons.
"""

from __future__ import annotations

import gzip
import secrets
from dataclasses import dataclass
from enum import Enum
from ipaddress import ip_address
from urllib.parse import parse_qs, urlsplit

from services.viewer import narrow

COOKIE = "crosspih_viewer"
MOST_HEAD_BYTES = 16_384
SECURE = "Referrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\nX-Frame-Options: SAMEORIGIN\r\n"
ICON = (
    "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 24 24'%3E%3Crect width='24' height='24' "
    "rx='5' fill='%231c2733'/%3E%3Cpath d='M9 4h6v5h5v6h-5v5H9v-5H4V9h5z' fill='%23dea43a'/%3E%3C/svg%3E"
)
# The theme is the browser's own setting unless a link of the page chose another; the link sets it with `?darkMode`.
THEME = """<script>(() => {
  const asked = new URLSearchParams(location.search), key = "crosspih-theme";
  let theme = null;
  try { if (asked.has("theme")) localStorage.setItem(key, asked.get("theme")); theme = localStorage.getItem(key); }
  catch (refused) { theme = asked.get("theme"); }
  const dark = theme === "dark" || (theme !== "light" && matchMedia("(prefers-color-scheme: dark)").matches);
  history.replaceState(null, "", location.pathname + (dark ? "?darkMode" : ""));
})();</script>"""


class GateVerdict(Enum):
    """The decision about a connection."""

    PAGE = "page"  # send the page itself
    PASS = "pass"  # pass on to the page's server
    COME_IN = "come in"  # the right token was sent: set a cookie, and redirect to the address without the token
    NO_TOKEN = "no token"
    ELSEWHERE = "elsewhere"  # another site's page, or another host name than this machine's
    MALFORMED = "malformed"


@dataclass(frozen=True, slots=True)
class Head:
    """The first lines of a request; header names in lower case."""

    method: str
    target: str
    headers: dict[str, str]


def head_of(first_lines: bytes) -> Head | None:
    """Parse a request's head, up to the empty line; None where it is no valid head."""
    try:
        request, *lines = first_lines.decode("latin-1").rstrip("\r\n").split("\r\n")
        method, target, version = request.split(" ")
        headers = {name.strip().lower(): value.strip() for name, value in (line.split(":", 1) for line in lines)}
    except ValueError:
        return None
    return Head(method, target, headers) if version.startswith("HTTP/1.") else None


def is_this_machine(host: str) -> bool:
    """Whether an address or a name without its port means this machine itself, reachable from here alone."""
    name = host.strip("[]").lower()
    if name == "localhost":
        return True
    try:
        return ip_address(name).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True, slots=True)
class Gate:
    """`token` is empty where no token is needed: the page is then served to this machine alone."""

    token: str

    def verdict(self, head: Head | None) -> GateVerdict:
        """The decision about a connection with this head."""
        if head is None or head.method != "GET" or "host" not in head.headers:
            return GateVerdict.MALFORMED
        url = urlsplit(head.target)
        upgrade = head.headers.get("upgrade", "").lower() == "websocket"
        if upgrade and _host_of(head.headers.get("origin", "")) != head.headers["host"].lower():
            return GateVerdict.ELSEWHERE
        if self.token:
            brought = parse_qs(url.query).get("token", [""])[0]
            if brought and self._is_token(brought):
                return GateVerdict.PASS if upgrade else GateVerdict.COME_IN
            if not self._is_token(_cookie_of(head.headers.get("cookie", ""))):
                return GateVerdict.NO_TOKEN
        elif not is_this_machine(_without_port(head.headers["host"])):
            return GateVerdict.ELSEWHERE
        return GateVerdict.PAGE if not upgrade and url.path in ("", "/", "/index.html") else GateVerdict.PASS

    def _is_token(self, brought: str) -> bool:
        return secrets.compare_digest(brought.encode(), self.token.encode())

    def answer(self, verdict: GateVerdict) -> bytes:
        """The whole answer to a client that is not let through."""
        if verdict is GateVerdict.COME_IN:
            cookie = f"{COOKIE}={self.token}; Path=/; HttpOnly; SameSite=Strict; Max-Age=604800"
            return f"HTTP/1.1 303 See Other\r\nLocation: /\r\nSet-Cookie: {cookie}\r\n{SECURE}{_END}\r\n".encode()
        status, text = {
            GateVerdict.NO_TOKEN: ("403 Forbidden", "This page wants the token that `crosspih ps` shows: /?token=..."),
            GateVerdict.ELSEWHERE: (
                "403 Forbidden",
                "Open this page by the address that `crosspih ps` shows; it answers to this machine's own name alone.",
            ),
        }.get(verdict, ("400 Bad Request", "That is no request for this page."))
        body = text.encode()
        head = f"HTTP/1.1 {status}\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: {len(body)}\r\n"
        return f"{head}{SECURE}Connection: close\r\n\r\n".encode() + body


_END = "Content-Length: 0\r\nConnection: close\r\n"


def page_answer(html: str, title: str) -> bytes:
    """The whole answer with the page: its own HTML with our title, icon, theme and style for phones."""
    begin = html.index("<head>") + len("<head>")
    added = f'<title>{title}</title><link rel="icon" href="{ICON}">{THEME}{narrow.STYLE}'
    body = gzip.compress((html[:begin] + added + html[begin:]).encode(), 6)
    head = (
        "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nContent-Encoding: gzip\r\n"
        f"Cache-Control: no-cache\r\nContent-Length: {len(body)}\r\n{SECURE}Connection: close\r\n\r\n"
    )
    return head.encode() + body


def _without_port(host: str) -> str:
    if host.startswith("["):
        return host.partition("]")[0] + "]"
    return host.partition(":")[0]


def _host_of(origin: str) -> str:
    return urlsplit(origin).netloc.lower()


def _cookie_of(header: str) -> str:
    for part in header.split(";"):
        name, _, value = part.strip().partition("=")
        if name == COOKIE:
            return value
    return ""
