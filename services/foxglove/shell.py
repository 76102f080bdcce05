"""Binds the WebSocket to the bus."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

from foxglove import Capability, Schema, start_server
from foxglove import Channel as SdkChannel
from foxglove import Context as SdkContext
from foxglove.websocket import ChannelView, Client, ServerListener, WebSocketServer

from crosspih_common.bus import Bus
from crosspih_common.errors import ConfigError
from crosspih_common.keys import (
    ADVISE_INSERTION,
    ANNOTATED_LEFT,
    ANNOTATED_RIGHT,
    ASSEMBLE,
    CAMERA_CALIBRATION,
    CAPTURE,
    CLOCK,
    CONTACT_STATE,
    CONTACT_WRENCH,
    ESTIMATE,
    EVENTS,
    FOLLOW,
    IMAGE_LEFT,
    IMAGE_RIGHT,
    JOINT_STATE,
    LOCATE,
    NETWORK,
    PHASE,
    REFUSAL,
    SEATED,
    SEQUENCE_NETWORK,
    STATUS,
    TOUCH,
    WRENCH_RAW,
    Topic,
)
from crosspih_common.messages import CellClock, Severity
from crosspih_common.service import ServiceContext
from services.foxglove.config import FoxgloveConfig
from services.foxglove.told import ViewerChannel, ViewerMessages

CATCH_UP_S = 0.2
# the replies of commands
REQUESTS = (ASSEMBLE, FOLLOW)
ANSWERS = (CAPTURE, LOCATE, ESTIMATE, SEATED, NETWORK, SEQUENCE_NETWORK, ADVISE_INSERTION, ASSEMBLE)
ValueT = TypeVar("ValueT")


class Looking(ServerListener):
    """Tells who looks at which topic."""

    def __init__(self, told: ViewerMessages) -> None:
        self._told = told

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """A viewer subscribes to a topic."""
        self._told.looks(channel.topic)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        """A viewer unsubscribes from a topic, or has disconnected."""
        self._told.looks_away(channel.topic)


class FoxgloveShell:
    """The WebSocket on the bus."""

    def __init__(self, context: ServiceContext, config: FoxgloveConfig) -> None:
        workcell, bus = context.cell.workcell, context.bus
        self._context = SdkContext()
        self._told = ViewerMessages(workcell, workcell.name, config.rate_hz, self._open)
        self._boot_id = ""
        self._server = self._started(config, f"crosspih {workcell.name}")
        self._closing = threading.Event()
        self._listen(bus)
        self._catching_up = threading.Thread(target=self._catch_up, name="foxglove:catch-up", daemon=True)
        self._catching_up.start()
        context.works.watch("what viewers that come late are told", self._catching_up.is_alive)
        address = f"ws://{config.host}:{self._server.port}"
        context.event(Severity.INFO, "foxglove", f"{address}: open a Foxglove WebSocket connection there")
        if config.is_open_to_others():
            context.event(
                Severity.WARNING, "foxglove_open", f"{address} asks nobody who comes: the whole network may look on"
            )

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return self._server.port

    def _started(self, config: FoxgloveConfig, name: str) -> WebSocketServer:
        try:
            return start_server(
                name=name, host=config.host, port=config.port, capabilities=[Capability.Time],
                server_listener=Looking(self._told), context=self._context, message_backlog_size=config.backlog,
            )  # fmt: skip
        except Exception as error:  # the library declares no type for it
            raise ConfigError(
                f"foxglove: {config.host}:{config.port} cannot be listened on ({error}); give another --port, or 0"
            ) from None

    def _open(self, name: str, schema: tuple[str, str, str, bytes], doc: str) -> ViewerChannel:
        schema_name, encoding, message_encoding, data = schema
        return SdkChannel(
            name, message_encoding=message_encoding, context=self._context, metadata={"doc": doc},
            schema=Schema(name=schema_name, encoding=encoding, data=data),
        )  # fmt: skip

    def _listen(self, bus: Bus) -> None:
        take = self._taker
        bus.subscribe_inline(CLOCK, self._clock)
        bus.subscribe(JOINT_STATE, take(JOINT_STATE))
        bus.subscribe(WRENCH_RAW, take(WRENCH_RAW))
        bus.subscribe(CONTACT_WRENCH, take(CONTACT_WRENCH))
        bus.subscribe(CONTACT_STATE, take(CONTACT_STATE))
        bus.subscribe(CAMERA_CALIBRATION, take(CAMERA_CALIBRATION))
        bus.subscribe(IMAGE_LEFT, take(IMAGE_LEFT))
        bus.subscribe(IMAGE_RIGHT, take(IMAGE_RIGHT))
        bus.subscribe(ANNOTATED_LEFT, take(ANNOTATED_LEFT))
        bus.subscribe(ANNOTATED_RIGHT, take(ANNOTATED_RIGHT))
        bus.subscribe(PHASE, take(PHASE))
        bus.subscribe(TOUCH, take(TOUCH))
        bus.subscribe(STATUS, take(STATUS))
        bus.subscribe(EVENTS, take(EVENTS))
        bus.subscribe(REFUSAL, take(REFUSAL))
        topics: tuple[Topic[Any], ...] = (
            *(one.request_echo for one in REQUESTS), *(one.reply_echo for one in ANSWERS)
        )  # fmt: skip
        for topic in topics:
            bus.subscribe(topic, take(topic))

    def _taker(self, topic: Topic[ValueT]) -> Callable[[ValueT], None]:  # type: ignore[type-var]
        told: Callable[[Topic[Any], Any], None] = self._told.take
        return lambda value: told(topic, value)

    def _clock(self, tick: CellClock) -> None:
        if self._boot_id not in ("", tick.boot_id):
            self._server.clear_session()  # the cell was started again: start afresh for every viewer
        self._boot_id = tick.boot_id
        self._server.broadcast_time(max(tick.stamp_ns, 0))

    def _catch_up(self) -> None:
        while not self._closing.wait(CATCH_UP_S):
            self._told.catch_up()

    def close(self) -> None:
        """Disconnect the viewers."""
        self._closing.set()
        self._catching_up.join()
        self._server.stop()
