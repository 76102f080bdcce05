"""A page that shows the pairs as they are taken, for a browser on this machine; `page.html` polls for updates."""

from __future__ import annotations

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import TracebackType
from typing import Any

PAGE = Path(__file__).with_name("page.html")
HOST = "127.0.0.1"
DRAWN = {"left": "seen-left.jpg", "right": "seen-right.jpg"}
HTML, JSON, JPEG = "text/html; charset=utf-8", "application/json", "image/jpeg"


class LivePage:
    """Served for the length of the context. The pictures are files of `folder`, replaced by their writer."""

    def __init__(self, folder: Path, title: str, port: int = 0) -> None:
        """Raises OSError where the port is taken."""
        self._folder, self._lock = folder, threading.Lock()
        self._told: dict[str, Any] = {"title": title, "state": "", "missing": [], "pairs": []}
        self._server = ThreadingHTTPServer((HOST, port), self._handler())
        self._server.daemon_threads = True
        self._thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, name="calibrate:page", daemon=True
        )

    def __enter__(self) -> LivePage:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    @property
    def address(self) -> str:
        """The address to open in a browser."""
        return f"http://{HOST}:{self._server.server_address[1]}/"

    def say(self, state: str) -> None:
        """Show the current step."""
        with self._lock:
            self._told["state"] = state

    def add(self, seen: dict[str, Any]) -> None:
        """Add one more pair, as vision saw it: `left`, `right`, `both`, `all` and what is `missing`."""
        with self._lock:
            self._told["pairs"].append({name: seen[name] for name in ("left", "right", "both", "all")})
            self._told["missing"] = list(seen["missing"])

    def _answer(self, path: str) -> tuple[str, bytes] | None:
        if path == "/":
            return HTML, PAGE.read_bytes()
        if path == "/state.json":
            with self._lock:
                return JSON, json.dumps(self._told).encode()
        file = DRAWN.get(path.removeprefix("/").removesuffix(".jpg"))
        if file is None or not (self._folder / file).exists():
            return None
        return JPEG, (self._folder / file).read_bytes()

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        page = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                answer = page._answer(self.path.split("?")[0])
                if answer is None:
                    self.send_error(404)
                    return
                kind, data = answer
                self.send_response(200)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(data)))
                self.send_header("Cache-Control", "no-store")
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, format: str, *args: Any) -> None:
                """Log nothing: the terminal belongs to the command."""

        return Handler
