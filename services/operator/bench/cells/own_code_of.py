"""The user's own code that affects a trial: strategies, estimators and networks by name, by their content."""

from __future__ import annotations

from typing import Any

from crosspih_common.messages import OwnStrategy
from crosspih_common.messages.assembly import AnyStrategy
from crosspih_common.own_code import content_digest
from crosspih_common.strategy import ENTRY_POINTS

SETTINGS = ("estimator", "network")  # of the section inference


def own_code_of(content: dict[str, Any], strategy: AnyStrategy) -> dict[str, str]:
    """{name: digest of its sources}, empty where no such code is used. Raises ConfigError where one cannot be found
    here.
    """
    found = {}
    if isinstance(strategy, OwnStrategy):
        found[f"strategy {strategy}"] = content_digest("strategy", strategy, ENTRY_POINTS)
    section = content.get("inference") or {}
    for setting in SETTINGS:
        if name := section.get(setting):
            found[f"{setting} {name}"] = content_digest(f"inference.{setting}", name)
    return found
