"""A strategy as a person names it on the command line."""

from __future__ import annotations

import difflib

from crosspih_common.errors import ConfigError
from crosspih_common.messages import OwnStrategy, Strategy, strategy_of
from crosspih_common.messages.assembly import AnyStrategy
from crosspih_common.own_code import declared
from crosspih_common.strategy import ENTRY_POINTS

NAMES = [one.value for one in Strategy]
STRATEGY_HELP = f"How to get the peg in: {', '.join(NAMES)}, or your own, module:Class."


def chosen(name: str) -> AnyStrategy:
    """A strategy of crosspih, or somebody's own by `module:Class` or by the name that an installed package declares.

    Raises ConfigError for a name that is none of these, before anything is started.
    """
    try:
        found = strategy_of(name)
    except ValueError as error:
        raise ConfigError(f"--{error}") from None
    known = [one.name for one in declared(ENTRY_POINTS)]
    if isinstance(found, OwnStrategy) and ":" not in name and name not in known:
        near = difflib.get_close_matches(name, [*NAMES, *known], 1)
        meant = f"did you mean {near[0]}? " if near else ""
        raise ConfigError(f"--strategy {name}: {meant}want {', '.join([*NAMES, *known])}, or your own as module:Class")
    return found
