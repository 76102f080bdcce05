"""ROS 2 without ROS: the protocol of rmw_zenoh over plain Zenoh, with rosbags for CDR and message definitions.

rosbags is an extra (`ros2`): it is imported where a `RosTypes` is made, nowhere before.
"""

from crosspih_common.ros2.attachment import Attachment
from crosspih_common.ros2.names import Endpoint, Entity, dds_type, topic_key
from crosspih_common.ros2.network import RosNetwork
from crosspih_common.ros2.node import RosNode, RosPublisher, RosSample
from crosspih_common.ros2.qos import RosQos
from crosspih_common.ros2.types import RosTypes

__all__ = [
    "Attachment",
    "Endpoint",
    "Entity",
    "RosNetwork",
    "RosNode",
    "RosPublisher",
    "RosQos",
    "RosSample",
    "RosTypes",
    "dds_type",
    "topic_key",
]
