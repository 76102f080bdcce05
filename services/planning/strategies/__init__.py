"""The strategies by name: what to do between seeing the hole and sitting in it."""

from __future__ import annotations

from collections.abc import Callable

from crosspih_common.messages import PosePrior, Strategy
from services.planning.run import Run
from services.planning.strategies.fused import fused
from services.planning.strategies.paper import paper

STRATEGIES: dict[Strategy, Callable[[Run], PosePrior]] = {Strategy.FUSED: fused, Strategy.PAPER: paper}
