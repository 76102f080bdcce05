"""Where the page listens, and that its own server answers nobody who did not come through the door."""

from __future__ import annotations

import socket

import pytest

pytest.importorskip("viser", reason="the page wants viser: pip install 'crosspih[viewer]'")

import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from crosspih_common.errors import ConfigError
from services.viewer.browser import open_browser
from services.viewer.door import listen


def test_a_port_in_use_is_said_in_one_line_and_the_next_one_is_taken_where_none_is_asked_for() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=f"port: {port} on 127.0.0.1 is in use by another program; give another"):
            listen("127.0.0.1", port)
    with pytest.raises(ConfigError, match=r"cannot listen on 203\.0\.113\.9"):
        listen("203.0.113.9", None)
    first, _ = listen("127.0.0.1", None)
    second, moved = listen("127.0.0.1", None)
    with first, second:
        assert second.getsockname()[1] > first.getsockname()[1] and "is in use: this one instead" in moved


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_the_server_behind_the_door_answers_nobody_who_walks_around_it() -> None:
    browser = open_browser("127.0.0.1", None, "a cell")
    try:
        assert browser.address == browser.without_token
        behind = f"ws://127.0.0.1:{browser.server.get_port()}/"
        protocols = [Subprotocol(f"viser-v{viser.__version__}")]
        for headers in (dict[str, str](), {"X-Crosspih-Passport": "guessed"}):
            around = connect(behind, subprotocols=protocols, additional_headers=headers)
            with around, pytest.raises(ConnectionClosed):
                around.recv(timeout=30.0)
        browser.server.request_share_url()  # what a page could ask for: no way to show it to the world
        assert browser.server._share_tunnel is None
    finally:
        browser.close()


def test_elsewhere_than_here_a_token_is_drawn_and_the_address_has_it() -> None:
    browser = open_browser("0.0.0.0", None, "a cell")
    try:
        token = browser.address.partition("?token=")[2]
        assert len(token) >= 32 and browser.without_token in browser.address and token not in browser.without_token
    finally:
        browser.close()
    given = open_browser("0.0.0.0", None, "a cell", token="of-my-own")
    given.close()
    assert given.address.endswith("?token=of-my-own")
