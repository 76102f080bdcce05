"""Samples of one topic as they come, undecoded, and what is said when none do."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Literal

from crosspih_common.errors import ConfigError
from crosspih_common.ros2 import Entity, RosNode, RosQos, RosSample, dds_type

ENOUGH, FEWEST = 100, 5  # samples for a rate
MEASURE_S = 2.0
RATE_SHARE = 0.2  # a rate that the cell's file says may be off by
SECOND_NS = 1_000_000_000

Stamps = Literal["header", "arrival"]


class RosTime:
    """When messages are from, by the cell's clock: this machine's monotonic one, for ROS's may be set or simulated.

    Header stamps keep their distances: they are moved by one offset, found at the first, when it arrived here. All
    devices of a process share it, so that their stamps compare as they do in ROS.
    """

    def __init__(self, stamps: Stamps) -> None:
        self._stamps = stamps
        self._offset_ns: int | None = None

    def stamp_ns(self, message: Any, sample: RosSample) -> int:
        """The message's time, ns."""
        if self._stamps == "arrival":
            return sample.arrived_ns
        stamp = message.header.stamp
        said_ns = int(stamp.sec) * SECOND_NS + int(stamp.nanosec)
        if self._offset_ns is None:
            self._offset_ns = sample.arrived_ns - said_ns
        return said_ns + self._offset_ns

    def begin_again(self) -> None:
        """ROS's time has been set: the next stamp is its new beginning."""
        self._offset_ns = None


class TopicSamples:
    """The last samples of one topic; Zenoh's thread puts them here, the device's takes them."""

    def __init__(self, node: RosNode, name: str, ros_type: str, field: str, qos: RosQos, keep: int) -> None:
        self.name, self.ros_type, self.field = name, ros_type, field
        self._node = node
        self._ring: deque[RosSample] = deque(maxlen=keep)
        self._changed = threading.Condition()
        self.count = 0
        node.subscribe(name, ros_type, self._take, qos)

    def _take(self, sample: RosSample) -> None:
        with self._changed:
            self._ring.append(sample)
            self.count += 1
            self._changed.notify_all()

    def decode(self, sample: RosSample) -> Any:
        """The message. ValueError where it is none."""
        return self._node.types.decode(sample.payload, self.ros_type)

    def newest(self, after: int, deadline_s: float) -> tuple[int, RosSample] | None:
        """The newest sample, once more than `after` have come, and how many have; None where none came in time."""
        until = time.monotonic() + deadline_s
        with self._changed:
            while self.count <= after:
                left = until - time.monotonic()
                if left <= 0.0:
                    return None
                self._changed.wait(left)
            return self.count, self._ring[-1]

    def taken(self, wait_s: float = 0.0) -> list[RosSample]:
        """What came since the last call, oldest first; where that is nothing, what comes within `wait_s`."""
        with self._changed:
            if not self._ring and wait_s:
                self._changed.wait(wait_s)
            found = list(self._ring)
            self._ring.clear()
            return found

    def wait_until(self, ready: Callable[[list[RosSample]], Any], deadline_s: float) -> Any:
        """The first true answer of `ready` to what is kept; None where there is none in time."""
        until = time.monotonic() + deadline_s
        with self._changed:
            while True:
                found = ready(list(self._ring))
                left = until - time.monotonic()
                if found or left <= 0.0:
                    return found or None
                self._changed.wait(left)

    def first(self, deadline_s: float) -> Any:
        """The first message, decoded. Raises ConfigError that says who is there instead."""
        got = self.newest(0, deadline_s)
        if got is None:
            raise ConfigError(f"{self.field}: nothing came on {self.name} within {deadline_s:g} s; {self._why()}")
        return self.decode(got[1])

    def rate_hz(self, ros_time: RosTime, said_hz: float | None) -> float:
        """How often samples come: measured, and where the file says it held to that. Raises ConfigError."""
        measured = self._measured_hz(ros_time)
        if said_hz is None:
            return measured
        if not abs(measured / said_hz - 1.0) <= RATE_SHARE:
            raise ConfigError(
                f"{self.field}.rate_hz: says {said_hz:g}, {measured:.0f} come; give what is true (ros2 topic hz "
                f"{self.name}), or leave it out"
            )
        return said_hz

    def _measured_hz(self, ros_time: RosTime) -> float:
        """Samples over the time between their stamps: also those that nobody had the time to look at are counted."""
        until = time.monotonic() + MEASURE_S
        first = self.newest(self.count, MEASURE_S)
        last = None
        if first is not None:
            last = self.newest(first[0] + ENOUGH, until - time.monotonic()) or self.newest(first[0] + FEWEST, 0.0)
        if first is None or last is None:
            raise ConfigError(
                f"{self.field}: fewer than {FEWEST} samples came on {self.name} in {MEASURE_S:g} s; {self._why()}"
            )
        began_ns, ended_ns = (ros_time.stamp_ns(self.decode(sample), sample) for _, sample in (first, last))
        if ended_ns <= began_ns:
            raise ConfigError(
                f"{self.field}: the header.stamp of {self.name} stands still; set hardware.ros2.stamps: arrival"
            )
        return (last[0] - first[0]) * 1e9 / (ended_ns - began_ns)

    def _why(self) -> str:
        """Who publishes under that name, or what is there instead."""
        there = self._node.graph(Entity.PUBLISHER)
        mine = [one for one in there if one.name == self.name]
        if not mine:
            names = ", ".join(sorted({one.name for one in there})) or "none"
            return (
                f"nobody publishes it in domain {self._node.domain_id} at {self._node.endpoint}; topics there: {names}"
            )
        one = mine[0]
        if one.type_name != dds_type(self.ros_type):
            return f"{one.node} publishes it as {one.ros_type}, want {self.ros_type}"
        if one.type_hash != self._node.types.hash(self.ros_type):
            return (
                f"{one.node} publishes {one.ros_type} of another definition ({one.type_hash[:20]}...) than "
                f"{self._node.types.distro}'s; set hardware.ros2.distro"
            )
        return (
            f"{one.node} is there and says nothing; is it still starting, or its controller inactive (ros2 control "
            "list_controllers)?"
        )


def require_one_publisher(node: RosNode, name: str, field: str) -> None:
    """Two that publish what one device says would be followed by turns. Raises ConfigError naming them."""
    found = sorted(one.node for one in node.graph(Entity.PUBLISHER, name))
    if len(found) > 1:
        raise ConfigError(
            f"{field}: {len(found)} publishers of {name}: {', '.join(found)}; want the device's alone: stop the "
            "others, or give them a namespace or another ROS_DOMAIN_ID"
        )
