"""A cell's messages converted to Foxglove's schemas, for common viewers. Pure functions; no service reads the result.

`FoxgloveTopics` takes crosspih's messages and gives (topic, stamp, protobuf bytes), for recordings and live.
"""

from crosspih_common.foxglove.converting import HEARD, OUT_OF_ORDER_NS, TRUTH_HEARD, FoxgloveTopics
from crosspih_common.foxglove.frames import arm_urdf
from crosspih_common.foxglove.schemas import ViewerTopic, descriptor_set, viewer_topics

__all__ = [
    "HEARD",
    "OUT_OF_ORDER_NS",
    "TRUTH_HEARD",
    "FoxgloveTopics",
    "ViewerTopic",
    "arm_urdf",
    "descriptor_set",
    "viewer_topics",
]
