"""A ROS 2 node over Zenoh, as rmw_zenoh's nodes see it: publishers, subscribers, services, and the graph."""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import zenoh
from zenoh import ext

from crosspih_common.bus.workers import Lane
from crosspih_common.bus.zenoh_transport import ZenohTransport, open_zenoh
from crosspih_common.errors import BusClosed
from crosspih_common.ros2.attachment import SampleAttachment
from crosspih_common.ros2.names import Entity, GraphEntity, dds_type, graph_expression, resolved, topic_key
from crosspih_common.ros2.qos import RELIABLE, RosQos
from crosspih_common.ros2.types import RosTypes

HEARTBEAT_S = 0.5  # rmw_zenoh's SAMPLE_MISS_DETECTION_HEARTBEAT_PERIOD
GRAPH_DEADLINE_S = 2.0


@dataclass(frozen=True, slots=True)
class RosSample:
    """A sample as it came, undecoded: when it arrived on this machine's monotonic clock, and what was attached."""

    payload: bytes
    arrived_ns: int
    attachment: bytes


class RosPublisher:
    """Sends on one topic."""

    def __init__(self, types: RosTypes, endpoint: GraphEntity, publisher: Any) -> None:
        self._types, self.endpoint, self._publisher = types, endpoint, publisher
        self._gid, self._numbers = endpoint.gid(), itertools.count(1)
        self._lock = threading.Lock()

    def publish(self, message: Any) -> None:
        """Send a message of the topic's type. Raises BusClosed."""
        self.publish_bytes(self._types.encode(message))

    def publish_bytes(self, payload: bytes) -> None:
        """Send what is CDR already. Raises BusClosed."""
        with self._lock:
            attachment = SampleAttachment(next(self._numbers), time.time_ns(), self._gid).to_bytes()
            try:
                self._publisher.put(payload, attachment=attachment)
            except zenoh.ZError as error:
                raise BusClosed(f"{self.endpoint.name}: cannot publish: {error}") from None


class RosNode:
    """One node with a Zenoh session of its own. Names without a leading slash stand in its namespace."""

    def __init__(
        self,
        endpoint: str,
        domain_id: int,
        types: RosTypes,
        name: str,
        namespace: str = "/",
        connect_s: float = 10.0,
        service: str = "operator",
    ) -> None:
        """`service`: whose certificate it shows, where there are any. Raises BusUnreachable when no router answers."""
        self.endpoint, self.domain_id, self.types, self.name, self.namespace = (
            endpoint,
            domain_id,
            types,
            name,
            namespace,
        )
        self._transport: ZenohTransport = open_zenoh(endpoint, connect_s, service)
        self._session = self._transport.session
        self._zid = str(self._session.info.zid())
        self._ids = itertools.count(1)
        self._declared: list[Any] = []
        self._lanes: list[Lane] = []
        self._declare_token(GraphEntity(Entity.NODE, domain_id, self._zid, 0, 0, namespace, name))

    def __enter__(self) -> RosNode:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _declare_token(self, endpoint: GraphEntity) -> None:
        self._declared.append(self._session.liveliness().declare_token(endpoint.token()))

    def _endpoint(self, entity: Entity, name: str, ros_type: str, qos: RosQos) -> GraphEntity:
        return GraphEntity(
            entity, self.domain_id, self._zid, 0, next(self._ids), self.namespace, self.name,
            resolved(name, self.namespace), dds_type(ros_type), self.types.hash(ros_type), qos,
        )  # fmt: skip

    def _key(self, endpoint: GraphEntity) -> str:
        return topic_key(self.domain_id, endpoint.name, endpoint.type_name, endpoint.type_hash)

    def publisher(self, name: str, ros_type: str, qos: RosQos = RELIABLE) -> RosPublisher:
        """A publisher; with `transient_local` its last messages are kept for late subscribers."""
        endpoint = self._endpoint(Entity.PUBLISHER, name, ros_type, qos)
        reliability = zenoh.Reliability.RELIABLE if qos.reliable else zenoh.Reliability.BEST_EFFORT
        drop = zenoh.CongestionControl.DROP
        if qos.transient_local:
            missed = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S)
            publisher: Any = ext.declare_advanced_publisher(
                self._session, self._key(endpoint), cache=ext.CacheConfig(qos.depth), publisher_detection=True,
                sample_miss_detection=missed if qos.reliable else None, congestion_control=drop,
                reliability=reliability,
            )  # fmt: skip
        else:
            publisher = self._session.declare_publisher(
                self._key(endpoint), congestion_control=drop, reliability=reliability
            )
        self._declared.append(publisher)
        self._declare_token(endpoint)
        return RosPublisher(self.types, endpoint, publisher)

    def subscribe(
        self, name: str, ros_type: str, handler: Callable[[RosSample], None], qos: RosQos = RELIABLE
    ) -> GraphEntity:  # fmt: skip
        """Call the handler with every sample, on Zenoh's own thread: it must only enqueue.

        Samples of all the node's topics come in the order in which they were sent: a wrench before the joint state that
        was said after it.
        """
        endpoint = self._endpoint(Entity.SUBSCRIBER, name, ros_type, qos)

        def receive(sample: zenoh.Sample) -> None:
            attached = sample.attachment.to_bytes() if sample.attachment is not None else b""
            handler(RosSample(sample.payload.to_bytes(), time.monotonic_ns(), attached))

        directly = zenoh.handlers.Callback(receive, indirect=False)
        if qos.transient_local:
            subscriber: Any = ext.declare_advanced_subscriber(
                self._session, self._key(endpoint), directly, subscriber_detection=True,
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=qos.depth),
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            )  # fmt: skip
        else:
            subscriber = self._session.declare_subscriber(self._key(endpoint), directly)
        self._declared.append(subscriber)
        self._declare_token(endpoint)
        return endpoint

    def serve(
        self, name: str, ros_type: str, handler: Callable[[bytes], Any], lane: Lane | None = None,
        when_busy: Any = None,
    ) -> GraphEntity:  # fmt: skip
        """Answer a service's requests: from the request's CDR to the response message, one after the other.

        They are answered on a thread of this service's own, or on the given lane; a request that finds the lane at
        work is queued, or answered by `when_busy` where that is given. A handler must not raise.
        """
        if lane is None:
            lane = Lane(f"ros2:{name}")
            self._lanes.append(lane)

        def accept(request: bytes, reply: Callable[[Any], None]) -> None:
            def job() -> Callable[[], None]:
                message = handler(request)
                return lambda: reply(message)

            if not lane.offer(job, only_when_idle=when_busy is not None):
                reply(when_busy)

        return self.serve_later(name, ros_type, accept)

    def serve_later(
        self, name: str, ros_type: str, accept: Callable[[bytes, Callable[[Any], None]], None]
    ) -> GraphEntity:  # fmt: skip
        """Pass each request (CDR) of a service to `accept`, with a function for its one response, at once or later.

        `accept` is called on Zenoh's own thread: it must only enqueue.
        """
        endpoint = self._endpoint(Entity.SERVICE, name, ros_type, RELIABLE)
        key = self._key(endpoint)

        def receive(query: zenoh.Query) -> None:
            try:
                attached = SampleAttachment.of(query.attachment.to_bytes() if query.attachment is not None else b"")
            except ValueError as error:
                with contextlib.suppress(zenoh.ZError):
                    query.reply_err(str(error).encode())
                query.drop()
                return

            def reply(message: Any) -> None:
                back = SampleAttachment(attached.sequence, time.time_ns(), attached.gid).to_bytes()
                with contextlib.suppress(zenoh.ZError):  # the caller may be gone
                    query.reply(key, self.types.encode(message), attachment=back)
                query.drop()

            accept(query.payload.to_bytes() if query.payload is not None else b"", reply)

        self._declared.append(self._session.declare_queryable(key, receive, complete=True))
        self._declare_token(endpoint)
        return endpoint

    def graph(self, entity: Entity | None = None, name: str | None = None) -> list[GraphEntity]:
        """The present graph entities, this node's own included: all of the domain, or of one kind, or of one name."""
        found = []
        full = None if name is None else resolved(name, self.namespace)
        expression = graph_expression(self.domain_id, entity)
        for reply in self._session.liveliness().get(expression, timeout=GRAPH_DEADLINE_S):
            if reply.ok is None:
                continue
            with contextlib.suppress(ValueError):  # a token of another program, which is ignored
                endpoint = GraphEntity.of(str(reply.ok.key_expr))
                if full is None or endpoint.name == full:
                    found.append(endpoint)
        return found

    def close(self) -> None:
        """Take back all that was declared and close the session. Safe to call twice."""
        declared, self._declared = self._declared, []
        for entity in reversed(declared):
            # RuntimeError: another thread is just using it and it cannot be taken back; the session's end does that
            with contextlib.suppress(zenoh.ZError, RuntimeError):
                entity.undeclare()
        for lane in self._lanes:
            lane.close()
        self._lanes.clear()
        self._transport.close()
