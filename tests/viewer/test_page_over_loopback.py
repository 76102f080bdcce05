"""The page as a service of its own, opened as a browser opens it: served, let in or not, and moving with the arm."""

from __future__ import annotations

import gzip
import itertools
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser", reason="the page wants viser: pip install 'crosspih[viewer]'")

import msgspec
import viser
import zstandard
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.sync.connection import Connection
from websockets.typing import Origin, Subprotocol

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.config import Workcell
from crosspih_common.keys import CLOCK, JOINT_STATE
from crosspih_common.messages import CellClock, JointState
from services.viewer.bodies import frames_of
from tests.conftest import Router, ServiceProcess

Spawn = Callable[..., ServiceProcess]
HOME = np.asarray(Workcell().home_joints_rad)
MOVED = HOME + np.array([0.3, 0.1, -0.1, 0.2, 0.1, 0.4])
EYE = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (1.0, 1.0, 1.0), "fov": 1.0, "near": 0.01,
    "far": 100.0, "image_height": 480, "image_width": 640, "look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 0.0, 1.0),
}  # fmt: skip
DEADLINE_S = 60.0


class Cell:
    """An arm that says where it is."""

    def __init__(self, endpoint: str) -> None:
        self._bus = Bus(open_zenoh(endpoint), "cell1", "hardware")
        self.joints = HOME
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._tell, daemon=True)
        self._thread.start()

    def _tell(self) -> None:
        clock, joints = self._bus.publisher(CLOCK), self._bus.publisher(JOINT_STATE)
        for tick in itertools.count(1):
            if self._closing.wait(0.02):
                return
            stamp = tick * 20_000_000
            clock.publish(CellClock(stamp_ns=stamp, boot_id="boot", realtime=True, simulated=True))
            still = (0.0,) * 6
            joints.publish(JointState(stamp_ns=stamp, joints_rad=tuple(self.joints.tolist()), speeds_rad_s=still))

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
        self._bus.close()


@pytest.fixture
def cell(router: Router) -> Iterator[Cell]:
    found = Cell(router.endpoint)
    yield found
    found.close()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


def opened(port: int, origin: str = "") -> ClientConnection:
    """The page's WebSocket, as a browser opens it."""
    return connect(
        f"ws://127.0.0.1:{port}/", subprotocols=[Subprotocol(f"viser-v{viser.__version__}")], max_size=None,
        origin=Origin(origin or f"http://127.0.0.1:{port}"), compression=None, open_timeout=DEADLINE_S,
    )  # fmt: skip


def messages(page: Connection) -> Iterator[dict[str, object]]:
    """What viser says: eight bytes of length, eight of the compressed length, and the rest as it says it."""
    while True:
        window = page.recv(timeout=DEADLINE_S)
        assert isinstance(window, bytes)
        packed = int.from_bytes(window[8:16], "little")
        inside = zstandard.ZstdDecompressor().decompress(
            window[16 : 16 + packed], max_output_size=int.from_bytes(window[:8], "little")
        )
        yield from msgspec.msgpack.decode(inside)["messages"]


def wait_for_place(page: Iterator[dict[str, object]], node: str, place_m: np.ndarray) -> None:
    """Until the scene says that a node is there."""
    for said in itertools.islice(page, 100_000):
        here = said["type"] == "SetPositionMessage" and said["name"] == node
        if here and np.allclose(np.asarray(said["position"], float), place_m, atol=1e-6):
            return
    pytest.fail(f"{node} never came to {place_m}")


def test_the_page_is_served_and_moves_with_the_arm(
    spawn: Spawn, router: Router, cell: Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = free_port()
    for variable in ("CROSSPIH_VIEWER_HOST", "CROSSPIH_VIEWER_PORT", "CROSSPIH_VIEWER_TOKEN"):
        monkeypatch.delenv(variable, raising=False)
    service = spawn("viewer", "--endpoint", router.endpoint, "--port", str(port))
    assert service.wait_for_line(f"page: http://127.0.0.1:{port}/"), "".join(service.output)
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=DEADLINE_S) as answer:
        html = gzip.decompress(answer.read()).decode()
    assert "<title>crosspih: cell1</title>" in html
    with opened(port) as page:
        page.send(msgspec.msgpack.encode(EYE))
        heard = messages(page)
        wait_for_place(heard, "/cell/link 6", frames_of(Workcell(), HOME)["link 6"].translation_m)
        cell.joints = MOVED
        wait_for_place(heard, "/cell/link 6", frames_of(Workcell(), MOVED)["link 6"].translation_m)
    with pytest.raises(InvalidStatus, match="403"):
        opened(port, "http://another.example").close()
    foreign = urllib.request.Request(f"http://127.0.0.1:{port}/", headers={"Host": "another.example"})
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(foreign, timeout=DEADLINE_S)
    second = spawn("viewer", "--port", str(port), "--recording", str(tmp_path / "none.mcap"))
    second.process.wait(DEADLINE_S)
    second.terminate()
    assert second.process.returncode == 1 and len(second.output) == 1 and "none.mcap" in second.output[0]
    assert service.terminate() == 0
