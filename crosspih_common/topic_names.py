"""A topic by its path below the cell's prefix, as a person types it."""

from __future__ import annotations

import dataclasses
import difflib
import re
from typing import Any

from crosspih_common.errors import ConfigError
from crosspih_common.keys import Topic, topics

EVERY_SERVICE = "{service}"


def topic_named(topic: Topic[Any] | str, reader: str | None = None) -> Topic[Any]:
    """The row of the key table. Of a topic that every service has, the path of one service (`service/vision/status`)
    means that one's, `service/{service}/status` or `service/*/status` everybody's.

    Raises ConfigError for an unknown path, with the nearest ones, and if `reader` may not read the topic: in a cell
    with certificates it would receive nothing.
    """
    found = _row(topic) if isinstance(topic, str) else topic
    if reader is not None and reader not in found.readers:
        raise ConfigError(
            f"{found.path}: only {' and '.join(found.readers)} may read it; a recording has it "
            f'(Recording("x.mcap").to_pandas("{found.path}"))'
        )
    return found


def _row(path: str) -> Topic[Any]:
    table = {row.path: row for row in topics()}
    if (found := table.get(path) or table.get(path.replace("*", EVERY_SERVICE))) is not None:
        return found
    for row in table.values():
        pattern = re.escape(row.path).replace(re.escape(EVERY_SERVICE), "[a-z0-9_]+")
        if EVERY_SERVICE in row.path and re.fullmatch(pattern, path):
            return dataclasses.replace(row, path=path)
    near = difflib.get_close_matches(path, table, 3, 0.5)
    meant = f"did you mean {' or '.join(near)}? " if near else ""
    raise ConfigError(f"{path}: no such topic; {meant}`crosspih keys` lists them all")
