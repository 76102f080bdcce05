"""`python -m services.viewer`: the page of the running cell; with `--recording FILE [FILE]`, of recordings."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from crosspih_common.errors import ConfigError, CrosspihError
from crosspih_common.modules import not_installed
from crosspih_common.service.ending import end_process

if TYPE_CHECKING:
    from crosspih_common.service.lifecycle import ServiceResource

HOST, PORT, TOKEN = "CROSSPIH_VIEWER_HOST", "CROSSPIH_VIEWER_PORT", "CROSSPIH_VIEWER_TOKEN"


def _arguments(argv: list[str]) -> tuple[argparse.Namespace, list[str]]:
    parser = argparse.ArgumentParser(
        prog="python -m services.viewer", description="A page in the browser that shows a cell live, or a recording.",
        epilog="Without --recording it is a service of the cell, and takes --cell and --endpoint as each does.",
    )  # fmt: skip
    port = os.environ.get(PORT) or None
    parser.add_argument("--host", default=os.environ.get(HOST) or None, help="where to listen; 127.0.0.1 if not given")
    parser.add_argument("--port", type=int, default=port, help="8080, or the next free one, if not given")
    parser.add_argument("--recording", type=Path, nargs="+", metavar="FILE", help="one recording, or two side by side")
    return parser.parse_known_args(argv)


def play_recordings(arguments: argparse.Namespace, rest: list[str]) -> int:
    """Serve the page of recordings until SIGINT or SIGTERM; returns the exit status."""
    try:
        from services.viewer.playback import play
    except ModuleNotFoundError as error:
        print(f"viewer: {not_installed(error)}", file=sys.stderr, flush=True)
        return 1
    parser = argparse.ArgumentParser()
    parser.add_argument("--cell", type=Path, default=None)
    cell = parser.parse_args(rest).cell
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    token = os.environ.get(TOKEN, "")
    try:
        playback = play(arguments.recording, cell, arguments.host or "127.0.0.1", arguments.port, token)
    except CrosspihError as error:
        print(f"viewer: {error}", file=sys.stderr, flush=True)
        return 1
    moved = f" ({playback.browser.moved})" if playback.browser.moved else ""
    print(f"viewer: {playback.browser.address}{moved}", flush=True)
    playback.run(stop)
    playback.browser.close()
    return 0


def serve_cell(arguments: argparse.Namespace, rest: list[str]) -> int:
    """Serve the page of a running cell, as one of its services; returns the exit status."""
    from crosspih_common.service import ServiceContext, run_service
    from services.viewer.config import ViewerConfig

    def build(context: ServiceContext, config: ViewerConfig) -> ServiceResource:
        try:
            from services.viewer.browser import open_browser
            from services.viewer.live import ViewerShell
        except ModuleNotFoundError as error:
            raise ConfigError(not_installed(error)) from None
        host, port = arguments.host or config.host, arguments.port or config.port
        title = f"crosspih: {context.cell.workcell.name}"
        return ViewerShell(context, config, open_browser(host, port, title, os.environ.get(TOKEN, "")))

    return run_service("viewer", ViewerConfig, build, rest)


def main(argv: list[str]) -> int:
    """Returns the exit status."""
    arguments, rest = _arguments(argv)
    if arguments.recording:
        return play_recordings(arguments, rest)
    return serve_cell(arguments, rest)


if __name__ == "__main__":
    end_process(main(sys.argv[1:]))
