"""Which topic is meant by its path, by its whole key, or by nearly its name; and who sends it. Pure."""

from __future__ import annotations

import re
from typing import Any

from crosspih_common.errors import ConfigError
from crosspih_common.keys import ROOT, Topic, topics
from crosspih_common.topic_names import EVERY_SERVICE, topic_named

NEAR = 3


def chosen_topic(name: str) -> Topic[Any]:
    """The topic that is meant by `ft/raw`, `service/planning/status`, `service/*/status`, or by a whole key.

    Raises ConfigError for a name that no topic has, with those that are nearest; its last part alone names those that
    end so: `wrench`.
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
    """The service that sends it; None: every one. One service's share of such a topic has its name in the path."""
    if topic.publisher != EVERY_SERVICE:
        return topic.publisher
    for row in topics():
        pattern = re.escape(row.path).replace(re.escape(EVERY_SERVICE), "([a-z0-9_]+)")
        if row.publisher == EVERY_SERVICE and (found := re.fullmatch(pattern, topic.path)):
            return found[1]
    return None
