"""The cell over a WebSocket: the shell on a bus in memory, the SDK's own server, and a client of its protocol."""

from __future__ import annotations

import json
import struct
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("foxglove", reason="no foxglove-sdk: pip install 'crosspih[foxglove]'")
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from crosspih_common.bus import Bus
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.config import load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.foxglove import HEARD, TRUTH_HEARD
from crosspih_common.keys import CLOCK, JOINT_STATE, PHASE, WRENCH_RAW, Topic
from crosspih_common.messages import AssemblyPhase, CellClock, JointState, Phase, RawWrenchBatch, Severity
from crosspih_common.modules import DEFAULT_CELL
from crosspih_common.security.access import IN, allowed
from crosspih_common.service import ServiceContext
from services.foxglove.config import FoxgloveConfig
from services.foxglove.shell import ANSWERS, REQUESTS, FoxgloveShell

PROTOCOL = "foxglove.sdk.v1"
DEADLINE_S = 30.0
MESSAGE, TIME = 1, 2  # of the protocol's binary messages


class Viewer:
    """A client that subscribes to all that it is offered, or to what it wants."""

    def __init__(self, port: int, wants: Callable[[str], bool] = lambda topic: True) -> None:
        self._stack = ExitStack()
        opened = connect(
            f"ws://127.0.0.1:{port}", close_timeout=0.5, subprotocols=[Subprotocol(PROTOCOL)], max_size=None
        )
        self._socket = self._stack.enter_context(opened)
        self._wants = wants
        self.channels: dict[str, dict[str, Any]] = {}
        self.told: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
        self.times: list[int] = []
        self._topics: dict[int, str] = {}

    def until(self, done: Callable[[Viewer], bool]) -> None:
        """Listen until something is so."""
        by = time.monotonic() + DEADLINE_S
        while not done(self):
            self._hear(self._socket.recv(timeout=max(by - time.monotonic(), 0.0)))

    def _hear(self, message: str | bytes) -> None:
        if isinstance(message, str):
            said = json.loads(message)
            if said["op"] == "advertise":
                for channel in said["channels"]:
                    self.channels[channel["topic"]] = channel
                    if self._wants(channel["topic"]):
                        number = len(self._topics) + 1
                        self._topics[number] = channel["topic"]
                        asked = {"id": number, "channelId": channel["id"]}
                        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": [asked]}))
        elif message[0] == MESSAGE:
            number, stamp_ns = struct.unpack_from("<IQ", message, 1)
            self.told[self._topics[number]].append((stamp_ns, message[13:]))
        elif message[0] == TIME:
            self.times.append(struct.unpack_from("<Q", message, 1)[0])

    def close(self) -> None:
        self._stack.close()


class Cell:
    """The service on a bus in memory, and what speaks to it."""

    def __init__(self, **settings: Any) -> None:
        hub = MemoryHub()
        self._buses = {name: Bus(hub.transport(), "cell1", name) for name in ("hardware", "planning", "foxglove")}
        self.context = ServiceContext("foxglove", load_cell(Path(DEFAULT_CELL)), self._buses["foxglove"])
        self.events: list[tuple[Severity, str, str]] = []
        self.context.event = lambda severity, code, text: self.events.append((severity, code, text))  # type: ignore[method-assign]
        self.shell = FoxgloveShell(self.context, FoxgloveConfig(port=0, **settings))
        self.port = self.shell.port
        self._publishers: dict[str, Any] = {}

    def say(self, topic: Topic[Any], message: Any) -> None:
        if topic.path not in self._publishers:
            self._publishers[topic.path] = self._buses[topic.publisher].publisher(topic)
        self._publishers[topic.path].publish(message)

    def close(self) -> None:
        self.shell.close()
        for bus in self._buses.values():
            bus.close()


@contextmanager
def running(**settings: Any) -> Iterator[Cell]:
    cell = Cell(**settings)
    try:
        yield cell
    finally:
        cell.close()


def phase(text: str, stamp_ns: int) -> AssemblyPhase:
    return AssemblyPhase(stamp_ns=stamp_ns, assembly_id="a", phase=Phase.PUSHING, text=text)


def test_a_viewer_is_told_what_happens_and_what_holds_already() -> None:
    with running() as cell:
        cell.say(PHASE, phase("before anybody looked", 1_000_000_000))
        viewer = Viewer(cell.port)
        viewer.until(lambda told: bool(told.told["/foxglove/log"]) and bool(told.told["/foxglove/scene/arm"]))
        stamp_ns, data = viewer.told["/foxglove/log"][0]
        assert (stamp_ns, Log.FromString(data).message) == (1_000_000_000, "pushing: before anybody looked")
        for index in range(5):
            at_ns = 2_000_000_000 + index * 100_000_000
            joints = JointState(stamp_ns=at_ns, joints_rad=(0.1,) * 6, speeds_rad_s=(0.0,) * 6)
            cell.say(JOINT_STATE, joints)
            rows = ((1.0, 2.0, 3.0, 0.1, 0.2, 0.3),) * 10
            cell.say(WRENCH_RAW, RawWrenchBatch(stamp_ns=at_ns, period_ns=1_000_000, samples=rows))
        # the first ones open the channels, for which nobody has asked yet
        viewer.until(lambda told: {"/foxglove/wrench/raw", "/foxglove/joint_states"} <= told.channels.keys())
        cell.say(CLOCK, CellClock(stamp_ns=3_000_000_000, boot_id="b", realtime=True))
        while len(viewer.told["/foxglove/wrench/raw"]) < 10 or not viewer.told["/foxglove/joint_states"]:
            at_ns += 100_000_000
            cell.say(JOINT_STATE, JointState(stamp_ns=at_ns, joints_rad=(0.2,) * 6, speeds_rad_s=(0.0,) * 6))
            cell.say(WRENCH_RAW, RawWrenchBatch(stamp_ns=at_ns, period_ns=1_000_000, samples=rows))
            heard = len(viewer.told["/foxglove/transforms"])
            viewer.until(lambda told, heard=heard: len(told.told["/foxglove/transforms"]) > heard)  # type: ignore[misc]
        frames = FrameTransforms.FromString(viewer.told["/foxglove/transforms"][-1][1]).transforms
        assert {"link_1", "flange", "peg", "tip", "hole"} <= {frame.child_frame_id for frame in frames}
        own = [name for name in viewer.channels if not name.startswith("/foxglove/")]
        assert all(viewer.channels[name]["encoding"] == "json" for name in own) and len(own) >= 3
        viewer.until(lambda told: 3_000_000_000 in told.times)
        assert not [name for name in viewer.channels if "truth" in name]
        viewer.close()


def test_streams_are_left_alone_while_nobody_looks() -> None:
    with running() as cell:
        for _ in range(3):
            cell.say(JOINT_STATE, JointState(stamp_ns=1_000, joints_rad=(0.1,) * 6, speeds_rad_s=(0.0,) * 6))
        cell.say(PHASE, phase("now", 1_000_000_000))
        viewer = Viewer(cell.port, wants=lambda topic: False)
        viewer.until(lambda told: "/foxglove/log" in told.channels)
        assert not [name for name in viewer.channels if "joint_state" in name]
        viewer.close()


def test_a_port_that_is_taken_is_said_and_an_open_one_is_warned_of() -> None:
    with running() as cell:
        with pytest.raises(ConfigError, match="--port"):
            FoxgloveShell(cell.context, FoxgloveConfig(port=cell.port))
        assert [code for _, code, _ in cell.events] == ["foxglove"]
    with running(host="0.0.0.0") as cell:
        assert [(severity, code) for severity, code, _ in cell.events][1:] == [(Severity.WARNING, "foxglove_open")]


def test_the_environment_goes_before_the_cells_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CROSSPIH_FOXGLOVE_PORT", "9000")
    assert FoxgloveConfig(port=1, rate_hz=10.0).by_environment() == FoxgloveConfig(port=9000, rate_hz=10.0)
    monkeypatch.setenv("CROSSPIH_FOXGLOVE_PORT", "many")
    with pytest.raises(ConfigError, match="CROSSPIH_FOXGLOVE_PORT"):
        FoxgloveConfig().by_environment()


def test_it_may_read_what_it_shows_and_nothing_of_the_truth() -> None:
    may = allowed()["foxglove", IN, "declare_subscriber"]
    assert {topic.key("*") for topic in HEARD} <= may
    assert not {topic.key("*") for topic in TRUTH_HEARD} & may
    subscribed = {one.request_echo for one in REQUESTS} | {one.reply_echo for one in ANSWERS}
    echoed = {topic for topic in HEARD if "foxglove" not in topic.readers}  # requests and answers have no rows
    assert {topic.path for topic in echoed} == {topic.path for topic in subscribed}
