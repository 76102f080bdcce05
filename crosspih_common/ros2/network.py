"""The settings of the ROS 2 network that the bridge and the ROS 2 devices share."""

from __future__ import annotations

import os

from pydantic import Field

from crosspih_common.bus.zenoh_transport import DEFAULT_ENDPOINT
from crosspih_common.config.section import Section
from crosspih_common.errors import ConfigError
from crosspih_common.ros2.node import RosNode
from crosspih_common.ros2.types import Distro, RosTypes

MAX_DOMAINS = 232


class RosNetwork(Section):
    """The router of the ROS nodes, their domain and their distribution."""

    endpoint: str | None = Field(
        default=None, description="of the router that rmw_zenoh's nodes connect to; the cell's own where not given"
    )
    domain_id: int | None = Field(default=None, ge=0, le=MAX_DOMAINS, description="ROS_DOMAIN_ID, or 0, if not given")
    distro: Distro = Field(default="jazzy", description="whose message definitions, and so type hashes, are spoken")
    namespace: str = Field(
        default="", pattern=r"^(/?[A-Za-z_][A-Za-z0-9_]*)*$", description="before every name that has no leading slash"
    )

    def domain(self, field: str) -> int:
        """The domain. Raises ConfigError where ROS_DOMAIN_ID is none."""
        if self.domain_id is not None:
            return self.domain_id
        said = os.environ.get("ROS_DOMAIN_ID", "") or "0"
        if not said.isdecimal() or int(said) > MAX_DOMAINS:
            raise ConfigError(f"{field}.domain_id: ROS_DOMAIN_ID is {said!r}, want 0 to {MAX_DOMAINS}")
        return int(said)

    def open(self, field: str, node: str, endpoint: str | None = None) -> RosNode:
        """A node on this network; `field` is the section's own name, for errors. Raises ConfigError, BusUnreachable."""
        where = self.endpoint or endpoint or os.environ.get("CROSSPIH_ENDPOINT") or DEFAULT_ENDPOINT
        namespace = f"/{self.namespace.strip('/')}"
        service = field.partition(".")[0]  # in whose process the node is
        return RosNode(where, self.domain(field), RosTypes(self.distro), node, namespace, service=service)
