"""Names as rmw_zenoh writes them: data keys, and the liveliness tokens from which `ros2 topic list` knows its graph.

Source: docs/design.md of rmw_zenoh and `rmw_zenoh_cpp/src/detail/liveliness_utils.cpp` (0.1.9 to 0.12.0).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from enum import Enum

from crosspih_common.ros2.attachment import GID_BYTES
from crosspih_common.ros2.qos import RELIABLE, RosQos

ADMIN_SPACE = "@ros2_lv"
_NODE_PARTS, _ENDPOINT_PARTS = 9, 13


class Entity(str, Enum):
    """The kind of graph entity that a token describes."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIBER = "MS"
    SERVICE = "SS"
    CLIENT = "SC"


def dds_type(ros_type: str) -> str:
    """sensor_msgs/msg/JointState as DDS names it: sensor_msgs::msg::dds_::JointState_. ValueError."""
    parts = ros_type.split("/")
    if len(parts) != 3 or not all(parts):
        raise ValueError(f"{ros_type!r} is no ROS 2 type, want package/msg/Name")
    return f"{parts[0]}::{parts[1]}::dds_::{parts[2]}_"


def ros_type(name: str) -> str:
    """The inverse of `dds_type`; a name of another form is left as it is."""
    parts = name.split("::")
    if len(parts) != 4 or parts[2] != "dds_":
        return name
    return f"{parts[0]}/{parts[1]}/{parts[3].removesuffix('_')}"


def resolved(name: str, namespace: str = "/") -> str:
    """A topic's or service's full name: one without a leading slash stands in the namespace."""
    if name.startswith("/"):
        return name
    return f"{namespace.rstrip('/')}/{name}"


def topic_key(domain_id: int, name: str, type_name: str, type_hash: str) -> str:
    """The key of a topic's samples or a service's queries; `type_name` as `dds_type` gives it."""
    return f"{domain_id}/{name.strip('/')}/{type_name}/{type_hash}"


def mangled(name: str) -> str:
    """A name encoded as one part of a token."""
    return name.replace("/", "%")


@dataclass(frozen=True, slots=True)
class GraphEntity:
    """A node, or an endpoint of a node; `name`, `type_name`, `type_hash` and `qos` are empty for the node itself."""

    entity: Entity
    domain_id: int
    session: str
    node_id: int
    entity_id: int
    namespace: str
    node: str
    name: str = ""
    type_name: str = ""
    type_hash: str = ""
    qos: RosQos = RELIABLE

    def token(self) -> str:
        """The liveliness key."""
        parts = [
            ADMIN_SPACE, str(self.domain_id), self.session, str(self.node_id), str(self.entity_id), self.entity.value,
            "%", mangled(self.namespace), mangled(self.node),
        ]  # fmt: skip
        if self.entity is not Entity.NODE:
            parts += [mangled(self.name), mangled(self.type_name), mangled(self.type_hash), self.qos.encode()]
        return "/".join(parts)

    def gid(self) -> bytes:
        """A unique id of 16 bytes. rmw_zenoh uses another hash of the token; nothing compares the two."""
        return hashlib.sha256(self.token().encode()).digest()[:GID_BYTES]

    @property
    def ros_type(self) -> str:
        """The type as ROS writes it."""
        return ros_type(self.type_name)

    @classmethod
    def of(cls, token: str) -> GraphEntity:
        """Parse a token. Raises ValueError if it is no token of rmw_zenoh."""
        parts = token.split("/")
        if len(parts) < _NODE_PARTS or parts[0] != ADMIN_SPACE or not all(parts):
            raise ValueError(f"{token!r} is no liveliness token of rmw_zenoh")
        entity = Entity(parts[5])
        namespace, node = parts[7].replace("%", "/"), parts[8].replace("%", "/")
        head = entity, int(parts[1]), parts[2], int(parts[3]), int(parts[4]), namespace, node
        if entity is Entity.NODE:
            return cls(*head)
        if len(parts) < _ENDPOINT_PARTS:
            raise ValueError(f"{token!r} has {len(parts)} parts, want {_ENDPOINT_PARTS}")
        name, type_name, type_hash = (part.replace("%", "/") for part in parts[9:12])
        return cls(*head, name, type_name, type_hash, RosQos.decode(parts[12]))


def graph_expression(domain_id: int, entity: Entity | None = None) -> str:
    """The expression for the tokens of a domain, or for those of one kind in it."""
    if entity is None:
        return f"{ADMIN_SPACE}/{domain_id}/**"
    return f"{ADMIN_SPACE}/{domain_id}/*/*/*/{entity.value}/**"
