"""The bus's bytes over Zenoh: every process is a client of one router.

This file handles these measured traps of Zenoh, so that no other code has to: a session left open hangs the interpreter
at exit; an unserved query and a callback that raises both look like an empty reply; the default configuration listens
on every interface and scouts by multicast; a full callback queue stops the whole session, so callbacks only enqueue.
"""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Sequence
from typing import Any

import zenoh
from zenoh import ext

from crosspih_common.bus.closing import close_at_exit
from crosspih_common.bus.served import ServedKeys
from crosspih_common.bus.transport import Answer, AuthoredHandler, Closeable, Query, Sender
from crosspih_common.endpoints import EXAMPLE, checked
from crosspih_common.errors import BusClosed, BusUnreachable, CommandTimeout, NoService
from crosspih_common.security.credentials import Credentials, credentials_from_environment, secure_endpoint

DEFAULT_ENDPOINT = EXAMPLE
HEARTBEAT_S = 0.5
# A link without a sign of life for this long counts as cut, and queries to a stopped process then end. (For a killed
# process the socket ends them within milliseconds.) The value is long, because a link that a busy machine cuts by
# mistake may cost an assembly.
LEASE_MS = 5000
# A service's liveliness token has a session of its own without other traffic. It is withdrawn after this time without a
# sign of life, and declared again automatically. If a busy machine does so by mistake, it costs one line in the log.
ALIVE_LEASE_MS = 800
ALIVE_BEATS = 16  # heartbeats in each such lease, sent by Zenoh's own threads, which Python code cannot delay
ALIVE_CONNECT_S = 10.0
# Off: for each session that ever sent a message of some kilobytes, the router and the receiver keep 16 MB mapped for
# good (measured: ten such sessions, 160 MB in both), and certificates do not protect the shared memory files.
NO_SHARED_MEMORY = {"transport/shared_memory/enabled": False}
# Our own timer ends the wait for an answer, to distinguish a late answer from none; Zenoh's timeout comes after it.
# Until then Zenoh holds half a kilobyte for each query, answered or not (tests/bus/measure_query_memory.py).
PAST_DEADLINE_S = 5.0
LIVING_S = 5.0  # limit for listing the tokens; a router answers within milliseconds
# Batches of 64 KiB that a link holds before it drops: the most that Zenoh allows. With its default of 2 a pause of some
# 50 ms on a busy machine lost samples.
QUEUE_BATCHES = 16
# Period at which a router on another machine is tried again, without end. It is longer than the lease, so that the
# other side has also dropped the cut link: a router that still held the old link was seen to keep neither of the two.
RETRY_MS = LEASE_MS + 2000


def router_config(
    endpoint: str,
    peers: bool = False,
    credentials: Credentials | None = None,
    also_listen: Sequence[str] = (),
    routers: Sequence[str] = (),
) -> zenoh.Config:
    """The configuration of the embedded router: it listens only on the given endpoints and does not scout.

    `also_listen` are further endpoints to listen on. `routers` are those of other machines to connect to: one router of
    each pair needs the other's endpoint, and the other may start later. `peers`: the router introduces Zenoh peers,
    such as ROS 2 nodes, to each other, so that they talk directly. With credentials it accepts only certificates of
    their authority and allows each what the key table says; another router is allowed what all services behind it are.
    """
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "router",
        "listen/endpoints": [secure_endpoint(one) if credentials else one for one in (endpoint, *also_listen)],
        "connect/endpoints": [secure_endpoint(one) if credentials else one for one in routers],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": RETRY_MS, "period_max_ms": RETRY_MS, "period_increase_factor": 1},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": peers,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/size/data": QUEUE_BATCHES,
        **NO_SHARED_MEMORY,
    }
    if credentials is not None:
        # the key table imports every message; a router without certificates does not need it
        from crosspih_common.security.access import access_control

        linked = bool(also_listen or routers)
        settings |= {**credentials.listening(), "access_control": access_control(linked)}
        if routers:
            settings |= credentials.connecting()
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def client_config(
    endpoint: str,
    connect_timeout_s: float,
    lease_ms: int = LEASE_MS,
    beats_a_lease: int = 4,
    credentials: Credentials | None = None,
) -> zenoh.Config:
    """The configuration of a client of the router at an endpoint; it reconnects after a restart of the router.

    It does not listen and connects to the router only, so that no peer can reach it directly.
    """
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "client",
        "connect/endpoints": [secure_endpoint(endpoint) if credentials else endpoint],
        "connect/timeout_ms": int(connect_timeout_s * 1000),
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "transport/link/tx/lease": lease_ms,
        "transport/link/tx/keep_alive": beats_a_lease,
        "transport/link/tx/queue/size/data": QUEUE_BATCHES,
        **NO_SHARED_MEMORY,
    }
    if credentials is not None:
        settings |= credentials.connecting()
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def open_zenoh(
    endpoint: str = DEFAULT_ENDPOINT, connect_timeout_s: float = 10.0, service: str = "operator"
) -> ZenohTransport:
    """Connect to the router, with the service's certificate where CROSSPIH_CERTIFICATES names a folder.

    Raises BusUnreachable when no router answers in time, ConfigError where the endpoint is no address or the
    certificate cannot be used.
    """
    credentials = credentials_from_environment(service, checked(endpoint))
    return ZenohTransport(_open_session(endpoint, connect_timeout_s, credentials), endpoint, credentials)


def _open_session(
    endpoint: str,
    connect_timeout_s: float,
    credentials: Credentials | None,
    lease_ms: int = LEASE_MS,
    beats_a_lease: int = 4,
) -> zenoh.Session:
    try:
        return zenoh.open(client_config(endpoint, connect_timeout_s, lease_ms, beats_a_lease, credentials))
    except zenoh.ZError as error:
        secure = f" or it refused {credentials.certificate} (`crosspih security show`)" if credentials else ""
        said = str(error).splitlines()[0].split(" at /")[0]  # without the place in Zenoh's sources
        why = "" if said.startswith("Unable to connect") else f" ({said[:120]})"
        raise BusUnreachable(
            f"no router answers at {endpoint} within {connect_timeout_s:g} s{secure}; start the stack with "
            f"`crosspih up` or name another with CROSSPIH_ENDPOINT{why}"
        ) from None


def _label(attachment: zenoh.ZBytes | None) -> str:
    """The label of a payload; bytes that are no UTF-8 are no label of ours and are rejected."""
    if attachment is None:
        return ""
    try:
        return attachment.to_string()
    except ValueError:
        return str(attachment.to_bytes(), "utf-8", "replace")


def _author(info: zenoh.SourceInfo | None) -> str:
    """The session that a sample or a query comes from; empty where it does not say."""
    return str(info.source_id.zid) if info is not None else ""


class _Declared:
    def __init__(self, entity: Any) -> None:
        self._entity = entity

    def close(self) -> None:
        # RuntimeError: another thread is using it just now, so it cannot be withdrawn; closing the session does that
        with contextlib.suppress(zenoh.ZError, RuntimeError):
            self._entity.undeclare()


class _ZenohSender(_Declared):
    """Sends the samples of a stream with the session that sent them, which an advanced publisher adds anyway."""

    def __init__(self, entity: zenoh.Publisher) -> None:
        super().__init__(entity)
        self._put, self._source = entity.put, zenoh.SourceInfo(entity.id, 0)

    def put(self, payload: bytes, label: str) -> None:
        try:
            self._put(payload, attachment=label, source_info=self._source)
        except zenoh.ZError as error:
            raise BusClosed(f"cannot publish: {error}") from None


class _AdvancedSender(_Declared):
    def put(self, payload: bytes, label: str) -> None:
        try:
            self._entity.put(payload, attachment=label)
        except zenoh.ZError as error:
            raise BusClosed(f"cannot publish: {error}") from None


class _ZenohQuery:
    def __init__(self, query: zenoh.Query) -> None:
        self._query: zenoh.Query | None = query
        self._key = str(query.key_expr)
        self.payload = query.payload.to_bytes() if query.payload is not None else b""
        self.label = _label(query.attachment)
        self.author = _author(query.source_info)

    def answer(self, answer: Answer) -> None:
        query, self._query = self._query, None
        if query is None:
            return
        # the caller may be gone; then there is nobody to answer
        with contextlib.suppress(zenoh.ZError):
            if answer.is_error:
                query.reply_err(answer.payload)
            else:
                query.reply(self._key, answer.payload, attachment=answer.label.encode())
        query.drop()


class ZenohTransport:
    """One Zenoh session that is always closed: by `close`, by the context manager, or at exit."""

    def __init__(self, session: zenoh.Session, endpoint: str, credentials: Credentials | None = None) -> None:
        self.endpoint: str | None = endpoint
        self._credentials = credentials
        self.author = str(session.zid())
        self._session = session
        self._served = ServedKeys(session)
        self._alive_session: zenoh.Session | None = None  # opened with the first token
        self._lock = threading.Lock()
        self._closed = False
        close_at_exit(self)

    def __enter__(self) -> ZenohTransport:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    @property
    def session(self) -> zenoh.Session:
        """The Zenoh session, for code that uses another protocol than the bus's over it."""
        return self._session

    def sender(self, key: str, *, recover: bool, history: int) -> Sender:
        """Declare a publisher. See Transport."""
        if not recover:
            return _ZenohSender(self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP))
        return _AdvancedSender(
            ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=zenoh.CongestionControl.DROP,
                cache=ext.CacheConfig(max(history, 1)),
                publisher_detection=True,
                sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S),
            )
        )

    def subscribe(self, key_expression: str, handler: AuthoredHandler, *, recover: bool) -> Closeable:
        """Call the handler with every sample. See Transport."""
        one_key = None if "*" in key_expression else key_expression  # then every sample has this key

        def receive(sample: zenoh.Sample) -> None:
            source = sample.source_info
            handler(
                one_key or str(sample.key_expr), sample.payload.to_bytes(), _label(sample.attachment),
                str(source.source_id.zid) if source is not None else "",
            )  # fmt: skip

        if not recover:
            return _Declared(self._session.declare_subscriber(key_expression, receive))
        return _Declared(
            ext.declare_advanced_subscriber(
                self._session,
                key_expression,
                receive,
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            )
        )

    def wait_served(self, key: str, wait_s: float) -> bool:
        """See Transport."""
        try:
            return self._served.wait(key, wait_s)
        except zenoh.ZError as error:
            raise BusClosed(f"cannot ask {key}: {error}") from None

    def query(self, key: str, payload: bytes, label: str, deadline_s: float) -> Answer:
        """Ask and wait. See Transport."""
        done = threading.Event()
        replies: list[zenoh.Reply] = []
        token = zenoh.CancellationToken()
        try:
            self._session.get(
                key,
                zenoh.handlers.Callback(replies.append, done.set),
                payload=payload,
                attachment=label.encode(),
                timeout=deadline_s + PAST_DEADLINE_S,
                target=zenoh.QueryTarget.BEST_MATCHING,
                congestion_control=zenoh.CongestionControl.BLOCK,
                cancellation_token=token,
                source_info=zenoh.SourceInfo(self._session.id, 0),
            )
        except zenoh.ZError as error:
            raise BusClosed(f"cannot ask {key}: {error}") from None
        if not done.wait(deadline_s):
            token.cancel()
            raise CommandTimeout(f"{key}: no answer within {deadline_s:g} s")
        for reply in replies:
            if reply.ok is not None:
                sample = reply.ok
                return Answer(sample.payload.to_bytes(), _label(sample.attachment), is_error=False)
            if reply.err is not None:
                return Answer(reply.err.payload.to_bytes(), "", is_error=True)
        raise NoService(f"{key}: nobody answers: whoever served it ended without a word (`crosspih ps`)")

    def serve(self, key: str, handler: Callable[[Query], None]) -> Closeable:
        """Call the handler with every query. See Transport."""
        return _Declared(self._session.declare_queryable(key, lambda query: handler(_ZenohQuery(query)), complete=True))

    def declare_alive(self, key: str) -> Closeable:
        """A liveliness token, on a session of its own. Raises BusUnreachable. See Transport."""
        assert self.endpoint is not None
        with self._lock:
            if self._closed:
                raise BusClosed(f"{key}: the bus is closed")
            if self._alive_session is None:
                self._alive_session = _open_session(
                    self.endpoint, ALIVE_CONNECT_S, self._credentials, ALIVE_LEASE_MS, ALIVE_BEATS
                )
            return _Declared(self._alive_session.liveliness().declare_token(key))

    def claim(self, key: str) -> Closeable:
        """A liveliness token on the session that publishes. See Transport."""
        try:
            return _Declared(self._session.liveliness().declare_token(key))
        except zenoh.ZError as error:
            raise BusClosed(f"cannot claim {key}: {error}") from None

    def living(self, key_expression: str) -> list[str]:
        """The keys of all tokens that there are now. See Transport."""
        try:
            replies = list(self._session.liveliness().get(key_expression, timeout=LIVING_S))
        except zenoh.ZError as error:
            raise BusClosed(f"cannot look for {key_expression}: {error}") from None
        if any(reply.err is not None for reply in replies):
            raise BusUnreachable(f"the router did not say within {LIVING_S:g} s who has {key_expression}")
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    def watch_alive(self, key_expression: str, handler: Callable[[str, bool], None]) -> Closeable:
        """Tokens coming and going. See Transport."""

        def receive(sample: zenoh.Sample) -> None:
            handler(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        return _Declared(self._session.liveliness().declare_subscriber(key_expression, receive, history=True))

    def close(self) -> None:
        """Close the session; safe to call twice."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        for session in (self._alive_session, self._session):
            with contextlib.suppress(zenoh.ZError):
                if session is not None:
                    session.close()
