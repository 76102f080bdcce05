"""The sockets by which services say that they are ready, in folders whose names are too long for a socket."""

from __future__ import annotations

import socket
import tempfile
from pathlib import Path

import pytest

from deploy.launcher.notify_socket import NotifyFolder


@pytest.mark.parametrize("deep", [False, True], ids=["the user's temporary folder", "one that is too deep as well"])
def test_a_socket_fits_wherever_the_state_lies(deep: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    temporary = tmp_path / ("x" * 90)
    temporary.mkdir()
    if deep:
        monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    folder = NotifyFolder(tmp_path / ("y" * 90) / "notify")
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready:
            ready.bind(str(folder.path / "a_service_of_a_long_name.sock"))
        assert folder.path.stat().st_mode & 0o077 == 0
        assert not list(temporary.iterdir())
    finally:
        folder.remove()
    assert not folder.path.exists()
