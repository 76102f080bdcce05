"""The commands that ROS can give: assembly, withdrawal, and abort. Nothing else from ROS reaches the arm.

Each is a std_srvs/Trigger; the assembly is also an action (action.py). It goes to planning as a normal command, with
all its limits, caps and refusals. The bridge itself can move nothing: it takes no lease of the arm and publishes no
set-point.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from crosspih_common.bus import Bus
from crosspih_common.bus.workers import Lane
from crosspih_common.errors import CrosspihError
from crosspih_common.keys import ABORT, ASSEMBLE, WITHDRAW
from crosspih_common.messages import AbortAssembly, Assemble, Failure, Strategy, Withdraw
from crosspih_common.ros2 import RosNode
from crosspih_common.ros2.types import TRIGGER
from services.ros2.action import AssembleAction
from services.ros2.outcomes import (
    ABORT_DEADLINE_S,
    ASSEMBLY_DEADLINE_S,
    WITHDRAW_DEADLINE_S,
    Said,
    assembly_outcome,
    error_outcome,
    withdrawal_outcome,
)


class Commands:
    """The services `assemble`, `withdraw` and `abort` of the bridge's node, and the action `assemble`."""

    def __init__(self, node: RosNode, bus: Bus, strategy: Strategy, base_frame: str) -> None:
        self._types, self._bus, self._strategy = node.types, bus, strategy
        self._motions = Lane("ros2:motions")
        busy = self._answer((False, "busy: another assembly or withdrawal is being carried out; nothing was queued"))
        for name, ask in (("assemble", self._assemble), ("withdraw", self._withdraw)):
            node.serve(name, TRIGGER, self._told(ask), lane=self._motions, when_busy=busy)
        node.serve("abort", TRIGGER, self._told(self._abort))
        self._action = AssembleAction(node, bus, self._motions, strategy, base_frame)

    def _answer(self, said: Said) -> Any:
        return self._types.make(f"{TRIGGER}_Response", success=said[0], message=said[1])

    def _told(self, ask: Callable[[], Said]) -> Callable[[bytes], Any]:
        def answer(_: bytes) -> Any:
            try:
                return self._answer(ask())
            except CrosspihError as error:
                return self._answer((False, str(error)))

        return answer

    def _assemble(self) -> Said:
        try:
            return assembly_outcome(self._bus.call(ASSEMBLE, Assemble(strategy=self._strategy), ASSEMBLY_DEADLINE_S))
        except CrosspihError as error:
            failure, text = error_outcome(error)
            return False, text if failure == Failure.REFUSED.value else f"{failure}: {text}"

    def _withdraw(self) -> Said:
        return withdrawal_outcome(self._bus.call(WITHDRAW, Withdraw(), WITHDRAW_DEADLINE_S))

    def _abort(self) -> Said:
        was_running = self._bus.call(ABORT, AbortAssembly(), ABORT_DEADLINE_S).was_running
        return True, "the assembly was told to end" if was_running else "no assembly was running"

    def close(self) -> None:
        """Carry out no further requests."""
        self._action.close()
        self._motions.close()
