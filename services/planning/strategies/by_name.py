"""The strategy of a request: one of ours, or somebody's own, loaded by name where the cell's file allows it."""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable

from crosspih_common.errors import CommandRefused, ConfigError
from crosspih_common.messages import Failure, PosePrior, Strategy
from crosspih_common.messages.assembly import AnyStrategy
from crosspih_common.own_code import load
from crosspih_common.security import CERTIFICATES
from crosspih_common.strategy import ENTRY_POINTS, AssemblyStrategy
from services.planning.config import PlanningConfig
from services.planning.ports import AssemblyFailed
from services.planning.run import Run
from services.planning.strategies import STRATEGIES
from services.planning.strategies.own_tools import RunTools


def strategy_named(name: AnyStrategy, config: PlanningConfig) -> Callable[[Run], PosePrior]:
    """What carries it out. Raises CommandRefused `no_strategy` with what is wrong and how to mend it."""
    if isinstance(name, Strategy):
        return STRATEGIES[name]
    require_allowed(name, config.strategies)
    try:
        made = load("strategy", name, ENTRY_POINTS)()
    except ConfigError as error:
        near = difflib.get_close_matches(name, [one.value for one in Strategy], 1)
        meant = f"did you mean {near[0]}? " if near and ":" not in name else ""
        raise CommandRefused("no_strategy", f"{meant}{error}") from None
    except Exception as error:  # its own constructor
        raise CommandRefused(
            "no_strategy", f"strategy {name}: cannot be made: {type(error).__name__}: {error}"
        ) from None
    if not isinstance(made, AssemblyStrategy):
        raise CommandRefused(
            "no_strategy",
            f"strategy {name}: {type(made).__name__} has no method assemble(tools) (crosspih_common/strategy.py)",
        )
    return _carried_out(name, made)


def require_allowed(name: str, allowed: tuple[str, ...] | None) -> None:
    """Raises CommandRefused `no_strategy` for a name that the cell's file does not list; one that lists none allows
    every name, but in a cell with certificates."""
    if allowed is None and not os.environ.get(CERTIFICATES):
        return
    if name not in (allowed or ()):
        raise CommandRefused(
            "no_strategy",
            f"strategy {name}: this cell runs none of that name; list it in its file, planning.strategies: [{name}]",
        )


def _carried_out(name: str, own: AssemblyStrategy) -> Callable[[Run], PosePrior]:
    def assemble(run: Run) -> PosePrior:
        belief: object = own.assemble(RunTools(run))
        if not isinstance(belief, PosePrior):
            raise AssemblyFailed(
                Failure.DEFECT, f"strategy {name}: assemble(tools) returned {type(belief).__name__}, want PosePrior"
            )
        return belief

    return assemble
