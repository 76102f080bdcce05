"""The bus's bytes over Zenoh: every process is a client of one router.

Measured traps that this file exists to keep away from everyone else: a session left open hangs the interpreter at exit;
an unserved query and a raising callback both look like an empty reply; the default configuration listens on every
interface and scouts by multicast; a full callback queue stops the whole session, so callbacks only enqueue.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import threading
import weakref
from collections.abc import Callable
from typing import Any

import zenoh
from zenoh import ext

from crosspih_common.bus.transport import Answer, Closeable, Handler, Query, Sender
from crosspih_common.errors import BusClosed, BusUnreachable, CommandTimeout, NoService

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
HEARTBEAT_S = 0.5
# Without a sign of life for so long a link counts as cut: a stopped process is then as gone as a killed one, its token
# taken back and what it was asked ended. (A killed one is gone within milliseconds, by its socket.)
LEASE_MS = 5000
# of a service that only computes: it is asked again, so that a link cut in error, on a machine that is busy beyond
# reason (seen at a load of 21 on two cores), costs a moment and not the assembly
COMPUTING_LEASE_MS = 800
# Batches of 64 KiB that a link holds before it drops: the most that Zenoh allows. With its default of 2 a pause of some
# 50 ms on a busy machine lost samples.
QUEUE_BATCHES = 16

_open: weakref.WeakSet[ZenohTransport] = weakref.WeakSet()


def router_config(endpoint: str) -> zenoh.Config:
    """The embedded router: listens on one endpoint only, no scouting."""
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "router",
        "listen/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/size/data": QUEUE_BATCHES,
    }
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def client_config(endpoint: str, connect_timeout_s: float, lease_ms: int = LEASE_MS) -> zenoh.Config:
    """A client of the router at an endpoint; comes back by itself when the router was restarted."""
    config = zenoh.Config()
    settings: dict[str, Any] = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": int(connect_timeout_s * 1000),
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "transport/link/tx/lease": lease_ms,
        "transport/link/tx/queue/size/data": QUEUE_BATCHES,
    }
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def open_zenoh(
    endpoint: str = DEFAULT_ENDPOINT, connect_timeout_s: float = 10.0, lease_ms: int = LEASE_MS
) -> ZenohTransport:
    """Connect to the router; without a sign of life for `lease_ms` it takes this process for gone.

    Raises BusUnreachable when none answers in time.
    """
    try:
        session = zenoh.open(client_config(endpoint, connect_timeout_s, lease_ms))
    except zenoh.ZError as error:
        raise BusUnreachable(
            f"no router answers at {endpoint} within {connect_timeout_s:g} s; start the stack with `crosspih up` "
            f"or name another with CROSSPIH_ENDPOINT ({str(error).splitlines()[0][:120]})"
        ) from None
    return ZenohTransport(session, endpoint)


class _Declared:
    def __init__(self, entity: Any) -> None:
        self._entity = entity

    def close(self) -> None:
        with contextlib.suppress(zenoh.ZError):
            self._entity.undeclare()


class _ZenohSender(_Declared):
    def put(self, payload: bytes, label: str) -> None:
        try:
            self._entity.put(payload, attachment=label.encode())
        except zenoh.ZError as error:
            raise BusClosed(f"cannot publish: {error}") from None


class _ZenohQuery:
    def __init__(self, query: zenoh.Query) -> None:
        self._query: zenoh.Query | None = query
        self._key = str(query.key_expr)
        self.payload = query.payload.to_bytes() if query.payload is not None else b""
        self.label = query.attachment.to_string() if query.attachment is not None else ""

    def answer(self, answer: Answer) -> None:
        query, self._query = self._query, None
        if query is None:
            return
        # the asker may be gone; then nobody is left to tell
        with contextlib.suppress(zenoh.ZError):
            if answer.is_error:
                query.reply_err(answer.payload)
            else:
                query.reply(self._key, answer.payload, attachment=answer.label.encode())
        query.drop()


class ZenohTransport:
    """One Zenoh session, closed for certain: by `close`, by the context manager, or at exit."""

    def __init__(self, session: zenoh.Session, endpoint: str) -> None:
        self.endpoint: str | None = endpoint
        self._session = session
        self._lock = threading.Lock()
        self._closed = False
        _open.add(self)

    def __enter__(self) -> ZenohTransport:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def sender(self, key: str, *, recover: bool, history: int) -> Sender:
        """Declare a publisher. See Transport."""
        if not recover:
            return _ZenohSender(self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP))
        return _ZenohSender(
            ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=zenoh.CongestionControl.DROP,
                cache=ext.CacheConfig(max(history, 1)),
                publisher_detection=True,
                sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S),
            )
        )

    def subscribe(self, key_expression: str, handler: Handler, *, recover: bool) -> Closeable:
        """Call the handler with every sample. See Transport."""

        def receive(sample: zenoh.Sample) -> None:
            label = sample.attachment.to_string() if sample.attachment is not None else ""
            handler(str(sample.key_expr), sample.payload.to_bytes(), label)

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
                # past our own deadline: what ends the wait is ours, so that a late answer is told from none
                timeout=deadline_s + 5.0,
                target=zenoh.QueryTarget.BEST_MATCHING,
                congestion_control=zenoh.CongestionControl.BLOCK,
                cancellation_token=token,
            )
        except zenoh.ZError as error:
            raise BusClosed(f"cannot ask {key}: {error}") from None
        if not done.wait(deadline_s):
            token.cancel()
            raise CommandTimeout(f"{key}: no answer within {deadline_s:g} s")
        for reply in replies:
            if reply.ok is not None:
                sample = reply.ok
                attachment = sample.attachment.to_string() if sample.attachment is not None else ""
                return Answer(sample.payload.to_bytes(), attachment, is_error=False)
            if reply.err is not None:
                return Answer(reply.err.payload.to_bytes(), "", is_error=True)
        raise NoService(f"{key}: nobody answers; is the service that serves it up? (`crosspih ps`)")

    def serve(self, key: str, handler: Callable[[Query], None]) -> Closeable:
        """Call the handler with every query. See Transport."""
        return _Declared(self._session.declare_queryable(key, lambda query: handler(_ZenohQuery(query)), complete=True))

    def declare_alive(self, key: str) -> Closeable:
        """A liveliness token. See Transport."""
        return _Declared(self._session.liveliness().declare_token(key))

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
        with contextlib.suppress(zenoh.ZError):
            self._session.close()


def _close_all() -> None:
    for transport in list(_open):
        transport.close()


def _close_when_main_ends() -> None:
    # Zenoh's callback threads are joined before atexit functions run, and they end only with their session: so the
    # sessions are closed by a daemon that waits for the main thread.
    threading.main_thread().join()
    _close_all()


_closer = threading.Thread(target=_close_when_main_ends, name="zenoh-close", daemon=True)
_closer.start()
# and the interpreter must not go on to its end while a session is still closing
atexit.register(_closer.join, 5.0)
