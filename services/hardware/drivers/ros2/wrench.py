"""A force/torque sensor that is a WrenchStamped topic."""

from __future__ import annotations

import numpy as np

from crosspih_common.ros2 import RosNode, RosQos
from services.hardware.drivers.ros2.config import Ros2Config
from services.hardware.drivers.ros2.samples import RosTime, TopicSamples, require_one_publisher
from services.hardware.protocols import WrenchSamples

FIELD = "hardware.ros2.force_torque"
WRENCH = "geometry_msgs/msg/WrenchStamped"
KEEP_S = 0.5  # what the loop may leave unread, at most
# After a pause of the network the joint state may be here first, and the sensor that speaks after it is not lost: by so
# much it is waited for, and only where nothing has come for a cycle.
BEHIND_S = 0.002


class RosWrench:
    """Implements WrenchDevice. The numbers are taken as they are, whatever frame the message names."""

    def __init__(self, node: RosNode, config: Ros2Config, ros_time: RosTime) -> None:
        """Raises ConfigError where nothing comes."""
        self._time = ros_time
        self._heard = TopicSamples(node, config.force_torque.topic, WRENCH, f"{FIELD}.topic", RosQos(), 4096)
        self.frame_id = self._heard.first(config.connect_s).header.frame_id
        require_one_publisher(node, config.force_torque.topic, f"{FIELD}.topic")
        self.rate_hz = self._heard.rate_hz(ros_time, config.force_torque.rate_hz)
        self.period_s = 1.0 / self.rate_hz
        self._most = max(4, round(KEEP_S * self.rate_hz))
        self._last_ns = -1

    def read(self) -> WrenchSamples:
        """What came since the last call, or within 2 ms; a sample that is older than one before is left out."""
        stamps, rows = [], []
        for sample in self._heard.taken(BEHIND_S)[-self._most :]:
            message = self._heard.decode(sample)
            stamp = self._time.stamp_ns(message, sample)
            if 0 <= self._last_ns - stamp < 1_000_000_000:
                continue
            self._last_ns = stamp
            force, torque = message.wrench.force, message.wrench.torque
            stamps.append(stamp)
            rows.append((force.x, force.y, force.z, torque.x, torque.y, torque.z))
        return WrenchSamples(np.array(stamps, dtype=np.int64), np.array(rows, dtype=float).reshape(-1, 6))
