"""ROS 2 without ROS: the protocol of rmw_zenoh over plain Zenoh, with rosbags for CDR and message definitions.

rosbags is an extra (`ros2`): it is imported where a `RosTypes` is made, nowhere before.
"""

from crosspih_common.ros2.attachment import SampleAttachment
from crosspih_common.ros2.names import Entity, GraphEntity, dds_type, topic_key
from crosspih_common.ros2.network import RosNetwork
from crosspih_common.ros2.node import RosNode, RosPublisher, RosSample
from crosspih_common.ros2.qos import RosQos
from crosspih_common.ros2.types import RosTypes

__all__ = [
    "Entity",
    "GraphEntity",
    "RosNetwork",
    "RosNode",
    "RosPublisher",
    "RosQos",
    "RosSample",
    "RosTypes",
    "SampleAttachment",
    "dds_type",
    "topic_key",
]
