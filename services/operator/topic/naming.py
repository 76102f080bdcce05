"""Finds a topic by its path, by its whole key, or by a similar name; and its sender. Pure."""

from __future__ import annotations

import re
from typing import Any

from crosspih_common.errors import ConfigError
from crosspih_common.keys import ROOT, Topic, topics
from crosspih_common.topic_names import EVERY_SERVICE, topic_named

NEAR = 3


def chosen_topic(name: str) -> Topic[Any]:
    """The topic of `ft/raw`, `service/planning/status`, `service/*/status`, or of a whole key.

    Raises ConfigError for a name that no topic has, with the nearest ones; the last part of a path alone, such as
    `wrench`, lists the topics that end with it.
    """
    path = re.sub(rf"^/?{ROOT}/[^/]+/", "", name).strip("/")
    try:
        return topic_named(path)
    except ConfigError as error:
        ending = [shown(row) for row in topics() if row.path.endswith(f"/{path}")][:NEAR]
        if not ending:
            raise ConfigError(str(error).replace(EVERY_SERVICE, "*")) from None
    raise ConfigError(f"{name}: no such topic; did you mean {' or '.join(ending)}? `crosspih keys` lists them all")


def shown(topic: Topic[Any]) -> str:
    """Its path as a person writes it."""
    return topic.path.replace(EVERY_SERVICE, "*")


def sender_of(topic: Topic[Any]) -> str | None:
    """The service that sends it; None: every service. The path of one service's share of such a topic contains its
    name.
    """
    if topic.publisher != EVERY_SERVICE:
        return topic.publisher
    for row in topics():
        pattern = re.escape(row.path).replace(re.escape(EVERY_SERVICE), "([a-z0-9_]+)")
        if row.publisher == EVERY_SERVICE and (found := re.fullmatch(pattern, topic.path)):
            return found[1]
    return None
