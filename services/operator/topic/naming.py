"""Which topic a person means: by its path, by its whole key, or by nearly its name. Pure."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from crosspih_common.errors import ConfigError
from crosspih_common.keys import ROOT, Topic, topics

SENDER = "{service}"
ANY = ("*", SENDER)
NEAR = 3


@dataclass(frozen=True, slots=True)
class ChosenTopic:
    """A topic of the table, and of which service it is wanted; None: of every service that sends it."""

    topic: Topic[Any]
    service: str | None = None

    @property
    def path(self) -> str:
        """As a person writes it."""
        return self.topic.path.replace(SENDER, self.service or "*")

    def is_of(self, key: str, cell: str) -> bool:
        """Whether a sample with this whole key is one of those that are wanted."""
        return self.service is None or key == self.topic.key(cell, self.service)

    @property
    def sender(self) -> str:
        """Who sends it, in words."""
        if self.topic.publisher != SENDER:
            return self.topic.publisher
        return self.service or "every service"


def chosen_topic(name: str, known: Iterable[Topic[Any]] | None = None) -> ChosenTopic:
    """The topic that is meant by `ft/raw`, `service/planning/status`, `service/*/status`, or by a whole key.

    Raises ConfigError for a name that no topic has, with those that are nearest.
    """
    table = {topic.path: topic for topic in (topics() if known is None else known)}
    path = re.sub(rf"^/?{ROOT}/[^/]+/", "", name).strip("/")
    if path in table:
        return ChosenTopic(table[path])
    for topic in table.values():
        if SENDER not in topic.path:
            continue
        pattern = re.escape(topic.path).replace(re.escape(SENDER), r"(?P<service>[a-z0-9_]+|\*)")
        if found := re.fullmatch(pattern, path):
            return ChosenTopic(topic, None if found["service"] in ANY else found["service"])
    near = nearest(path, [one.replace(SENDER, "*") for one in table])
    meant = f"did you mean {' or '.join(near)}? " if near else ""
    raise ConfigError(f"{name}: no topic has that name; {meant}`crosspih topic list` shows all of them")


def nearest(path: str, known: list[str]) -> list[str]:
    """The paths nearest to what was written, best first; a last part alone is enough: `wrench`."""
    tails = [one for one in known if one.endswith(f"/{path}")]
    return (tails or difflib.get_close_matches(path, known, n=NEAR, cutoff=0.6))[:NEAR]
