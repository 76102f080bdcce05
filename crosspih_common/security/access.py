"""Zenoh's access rules, made from the key table: whatever no row allows is denied.

Each service, identified by the common name of its certificate, may publish, read, query and answer the keys in its
rows. The rules also allow the declarations that Zenoh sends for these keys, both ways, and the keys of its advanced
publishers below `<key>/@adv/`. `*` stands for the cell: a router may serve several.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Any

from crosspih_common.keys import (
    ADVISE_INSERTION,
    ALL,
    ASSEMBLE,
    CAMERA_ALIVE,
    CAPTURE,
    CLOCK,
    ESTIMATE,
    FOLLOW,
    LEASE_BEAT,
    LEASE_TAKE,
    LOCATE,
    NETWORK,
    ROOT,
    SEATED,
    SEQUENCE_NETWORK,
    WITHDRAW,
    Command,
    Qos,
    Topic,
    alive_key,
    author_key,
    commands,
    topics,
)

CELL = "*"
ROUTER = "router"
SERVICES = (*ALL, CAMERA_ALIVE, ROUTER)  # whoever has a certificate
ADVANCED = "/@adv/**"  # where Zenoh's advanced publishers keep what they need beside their key
IN, OUT = "ingress", "egress"
# Replies of commands that ROS 2 receives: the pose of the hole, and how an assembly ended.
ANSWERS_TO_ROS2 = (ASSEMBLE, LOCATE)
# Foxglove also shows the requests and replies of commands.
REQUESTS_TO_FOXGLOVE = (ASSEMBLE, FOLLOW)
ANSWERS_TO_FOXGLOVE = (ADVISE_INSERTION, ASSEMBLE, CAPTURE, ESTIMATE, LOCATE, NETWORK, SEATED, SEQUENCE_NETWORK)
# The web page also shows the estimates of the hole that the planner received.
ANSWERS_TO_VIEWER = (ASSEMBLE, WITHDRAW, LOCATE, ESTIMATE, SEATED, NETWORK, SEQUENCE_NETWORK)
# ROS 2's own keys: its domains and its tokens, for the services that speak it
ROS2_SPEAKERS = ("ros2", "hardware")
ROS2_KEYS = ("@ros2_lv/**", *(f"{domain}/**" for domain in range(102)))  # the domains that ROS 2 allows on every system
EVERY_MESSAGE = (
    "put", "delete", "declare_subscriber", "query", "reply", "declare_queryable",
    "liveliness_token", "declare_liveliness_subscriber", "liveliness_query",
)  # fmt: skip


class _Table:
    """(service, direction, message): keys."""

    def __init__(self) -> None:
        self.allowed: dict[tuple[str, str, str], set[str]] = defaultdict(set)

    def allow(self, services: Iterable[str], flow: str, messages: Iterable[str], keys: Iterable[str]) -> None:
        for service in services:
            for message in messages:
                self.allowed[service, flow, message].update(keys)

    def publish(self, service: str, key: str, read_as: str, recover: bool) -> None:
        """A service publishes `key`, and is notified of readers of `read_as`, which may be wider."""
        self.allow([service], IN, ["put"], [key])
        self.allow([service], OUT, ["declare_subscriber"], [key, read_as])
        if recover:
            beside, asked = [key + ADVANCED], [key + ADVANCED, read_as + ADVANCED]
            self.allow([service], IN, ["put", "liveliness_token", "declare_queryable"], beside)
            self.allow([service], IN, ["reply"], [key, *beside])
            self.allow([service], OUT, ["query", "declare_subscriber", "declare_liveliness_subscriber"], asked)

    def read(self, service: str, key: str, recover: bool) -> None:
        self.allow([service], IN, ["declare_subscriber"], [key])
        self.allow([service], OUT, ["put"], [key])
        if recover:
            beside = [key + ADVANCED]
            reading = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
            self.allow([service], IN, reading, beside)
            self.allow([service], OUT, ["put", "liveliness_token", "declare_queryable"], beside)
            self.allow([service], OUT, ["reply"], [key, *beside])

    def serve(self, service: str, key: str) -> None:
        self.allow([service], IN, ["declare_queryable", "reply"], [key])
        self.allow([service], OUT, ["query"], [key])

    def ask(self, service: str, key: str) -> None:
        self.allow([service], IN, ["query"], [key])
        self.allow([service], OUT, ["reply", "declare_queryable"], [key])

    def live(self, service: str, names: Iterable[str]) -> None:
        """A service declares tokens under its names, and sees all tokens."""
        for name in names:
            self.allow([service], IN, ["liveliness_token"], [alive_key(CELL, name), author_key(CELL, name)])
        everyone = [alive_key(CELL), author_key(CELL)]
        self.allow([service], IN, ["declare_liveliness_subscriber", "liveliness_query"], everyone)
        self.allow([service], OUT, ["liveliness_token"], everyone)


def _publishers(topic: Topic[Any]) -> tuple[str, ...]:
    if topic.publisher == "{service}":
        return (*LEASE_TAKE.callers, LEASE_TAKE.server) if topic is LEASE_BEAT else SERVICES
    return (topic.publisher, CAMERA_ALIVE) if _of_camera(topic.path) else (topic.publisher,)


def _servers(command: Command[Any, Any]) -> tuple[str, ...]:
    return (command.server, CAMERA_ALIVE) if command is CAPTURE else (command.server,)


def _of_camera(path: str) -> bool:
    return path.startswith("camera/")


def allowed() -> dict[tuple[str, str, str], frozenset[str]]:
    """(service, `ingress` or `egress` of the router, Zenoh's message): the key expressions that are allowed."""
    table = _Table()
    for topic in topics():
        recover = topic.qos is Qos.RECOVER
        for service in _publishers(topic):
            table.publish(service, topic.key(CELL, service), topic.key(CELL), recover)
        for service in topic.readers:
            table.read(service, topic.key(CELL), recover)
    for command in commands():
        for service in _servers(command):
            table.serve(service, command.key(CELL))
        for service in command.callers:
            table.ask(service, command.key(CELL))
        told = (("ros2", ANSWERS_TO_ROS2), ("foxglove", ANSWERS_TO_FOXGLOVE), ("viewer", ANSWERS_TO_VIEWER))
        for service, answers in told:
            if command in answers:
                table.read(service, command.reply_echo.key(CELL), recover=True)
        if command in REQUESTS_TO_FOXGLOVE:
            table.read("foxglove", command.request_echo.key(CELL), recover=True)
    for service in SERVICES:
        table.read(service, CLOCK.key(CELL), recover=True)  # every bus follows the cell's clock
        table.live(service, (service, CAMERA_ALIVE) if service == CAPTURE.server else (service,))
    table.allow(ROS2_SPEAKERS, IN, EVERY_MESSAGE, ROS2_KEYS)
    table.allow(ROS2_SPEAKERS, OUT, EVERY_MESSAGE, ROS2_KEYS)
    return {where: frozenset(keys) for where, keys in table.allowed.items()}


def linked() -> dict[tuple[str, str, str], frozenset[str]]:
    """The additional rights of another machine's router: all that its services may do, because it forwards for them.

    This router cannot see which service a message is from: the other router has checked their certificates.
    """
    everything = frozenset([f"{ROOT}/**", f"{ROOT}/**{ADVANCED}", *ROS2_KEYS])
    return {(ROUTER, flow, message): everything for flow in (IN, OUT) for message in EVERY_MESSAGE}


def access_control(other_routers: bool = False) -> dict[str, Any]:
    """Zenoh's `access_control` section for the router: nothing is allowed but what `allowed` lists, and `linked` where
    routers of other machines are let in."""
    rules: list[dict[str, Any]] = []
    by_service: dict[str, list[str]] = {service: [] for service in SERVICES}
    for (service, flow, message), keys in sorted({**allowed(), **(linked() if other_routers else {})}.items()):
        name = f"{service} {flow} {message}"
        rules.append({
            "id": name, "permission": "allow", "flows": [flow], "messages": [message], "key_exprs": sorted(keys),
        })  # fmt: skip
        by_service[service].append(name)
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": service, "cert_common_names": [service]} for service in SERVICES],
        "policies": [{"rules": names, "subjects": [service]} for service, names in by_service.items()],
    }
