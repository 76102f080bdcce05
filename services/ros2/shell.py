"""Binds the bridge's node to the bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from crosspih_common.bus import Bus
from crosspih_common.errors import BusClosed, BusError
from crosspih_common.keys import (
    ASSEMBLE,
    CAMERA_CALIBRATION,
    CLOCK,
    CONTACT_WRENCH,
    EVENTS,
    IMAGE_LEFT,
    IMAGE_RIGHT,
    JOINT_STATE,
    LOCATE,
    STATUS,
    WRENCH_RAW,
    Command,
)
from crosspih_common.messages import Severity
from crosspih_common.ros2.frames import ros_arm
from crosspih_common.ros2.topics import Topics
from crosspih_common.service import ServiceContext
from services.ros2.commands import Commands
from services.ros2.config import BridgeConfig, devices_of_ros

DIAGNOSE_S = 1.0
HeardT = TypeVar("HeardT")


class BridgeShell:
    """The bridge on the bus and in ROS."""

    def __init__(self, context: ServiceContext, config: BridgeConfig) -> None:
        workcell, bus = context.cell.workcell, context.bus
        arm = ros_arm(workcell, "ros2", config.joint_names, config.base_frame, config.flange_frame)
        self._node = config.open("ros2", config.node, bus.endpoint)
        has = devices_of_ros(context.cell.sections["hardware"])
        self._topics = Topics(
            self._node, arm, workcell, time.time_ns, stamps=config.stamps, tf_hz=config.tf_hz, has=has
        )
        self._closing = threading.Event()
        self._listen(bus, has)
        self._commands = Commands(self._node, bus, config.strategy, arm.frames.base) if config.commands else None
        self._diagnosing = threading.Thread(target=self._diagnose, name="diagnostics", daemon=True)
        self._diagnosing.start()
        context.event(
            Severity.INFO, "ros2",
            f"node {self._node.namespace.rstrip('/')}/{self._node.name} in domain {self._node.domain_id} by "
            f"{self._node.endpoint}, {config.distro}'s messages"
            + (f"; left out, for they are ROS's own: the topics of {', '.join(sorted(has))}" if has else "")
            + ("" if config.commands else "; ros2.commands is off: ROS can only listen"),
        )  # fmt: skip

    def _listen(self, bus: Bus, has: frozenset[str]) -> None:
        topics, take = self._topics, self._until_closed
        bus.subscribe_inline(CLOCK, take(topics.clock))
        if "arm" not in has:
            bus.subscribe(JOINT_STATE, take(topics.joint_state))
        bus.subscribe(WRENCH_RAW, take(topics.raw_batch))
        bus.subscribe(CONTACT_WRENCH, take(topics.contact_wrench))
        if "camera" not in has:
            bus.subscribe(CAMERA_CALIBRATION, take(topics.calibration))
            bus.subscribe(IMAGE_LEFT, take(topics.left_image))
            bus.subscribe(IMAGE_RIGHT, take(topics.right_image))
        bus.subscribe(STATUS, take(topics.status))
        bus.subscribe(EVENTS, take(topics.event))
        answered: tuple[tuple[Command[Any, Any], Callable[[Any], None]], ...] = (
            (LOCATE, topics.hole),
            (ASSEMBLE, topics.assembled),
        )
        for command, hear in answered:
            bus.subscribe(command.reply_echo, take(hear))

    def _until_closed(self, take: Callable[[HeardT], None]) -> Callable[[HeardT], None]:
        """Ignore bus messages that arrive while the node is closing: nobody can receive them in ROS."""

        def told(heard: HeardT) -> None:
            try:
                take(heard)
            except BusClosed:
                if not self._closing.is_set():
                    raise

        return told

    def _diagnose(self) -> None:
        while not self._closing.wait(DIAGNOSE_S):
            try:
                self._topics.diagnose()
            except BusError:
                return  # the session is closed, and this thread ends

    def close(self) -> None:
        """Leave the graph."""
        self._closing.set()
        self._diagnosing.join()
        if self._commands is not None:
            self._commands.close()
        self._node.close()
