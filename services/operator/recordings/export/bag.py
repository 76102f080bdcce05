"""A ROS 2 bag that is written by rosbags: metadata.yaml, and an MCAP file with ros2msg schemas and CDR messages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from crosspih_common.ros2 import RosQos, RosTypes
from crosspih_common.ros2.names import resolved

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Qos

VERSION: Literal[9] = 9  # of rosbag2's metadata, since Iron


class BagTopic:
    """One topic of a bag."""

    def __init__(self, bag: Bag, name: str, connection: Connection) -> None:
        self._bag, self._name, self._connection = bag, name, connection

    def publish(self, message: Any) -> None:
        """Write a message at the bag's present time."""
        bag = self._bag
        bag.writer.write(self._connection, bag.now_ns, bag.types.encode(message))
        bag.counts[self._name] += 1


class Bag:
    """Implements Publishers. `now_ns` is the time of the next messages; `counts` are their numbers by topic."""

    def __init__(self, folder: Path, types: RosTypes) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer

        self.types = types
        self.now_ns = 0
        self.counts: dict[str, int] = {}
        self.writer = Writer(folder, version=VERSION, storage_plugin=StoragePlugin.MCAP)

    def __enter__(self) -> Bag:
        self.writer.open()
        return self

    def __exit__(self, *exc: object) -> None:
        self.writer.close()

    def publisher(self, name: str, ros_type: str, qos: RosQos) -> BagTopic:
        """Begin a topic."""
        full = resolved(name)
        self.counts[full] = 0
        connection = self.writer.add_connection(
            full, ros_type, typestore=self.types.store, offered_qos_profiles=[_offered(qos)]
        )
        return BagTopic(self, full, connection)


def _offered(qos: RosQos) -> Qos:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    never = QosTime(9223372036, 854775807)
    return Qos(
        QosHistory.KEEP_LAST, qos.depth, QosReliability.RELIABLE if qos.reliable else QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL if qos.transient_local else QosDurability.VOLATILE, never, never,
        QosLiveliness.AUTOMATIC, never, False,
    )  # fmt: skip
