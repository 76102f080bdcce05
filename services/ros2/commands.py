"""What ROS may ask for: an assembly, a withdrawal, and their end. Nothing else of ROS reaches the arm.

Each is a std_srvs/Trigger and goes to planning as a command of ours, with all its limits, caps and refusals; the bridge
itself can move nothing: it takes no lease of the arm and publishes no set-point.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from crosspih_common.bus import Bus
from crosspih_common.bus.workers import Lane
from crosspih_common.errors import CrosspihError
from crosspih_common.keys import ABORT, ASSEMBLE, WITHDRAW
from crosspih_common.messages import AbortAssembly, Assemble, AssemblyResult, Strategy, Withdraw, WithdrawResult
from crosspih_common.ros2 import RosNode
from crosspih_common.ros2.types import TRIGGER

ASSEMBLY_DEADLINE_S = 900.0
WITHDRAW_DEADLINE_S = 300.0
ABORT_DEADLINE_S = 5.0
Said = tuple[bool, str]


class Commands:
    """The services `assemble`, `withdraw` and `abort` of the bridge's node."""

    def __init__(self, node: RosNode, bus: Bus, strategy: Strategy) -> None:
        self._types, self._bus, self._strategy = node.types, bus, strategy
        self._motions = Lane("ros2:motions")
        busy = self._answer((False, "busy: another assembly or withdrawal is being carried out; nothing was queued"))
        for name, ask in (("assemble", self._assemble), ("withdraw", self._withdraw)):
            node.serve(name, TRIGGER, self._told(ask), lane=self._motions, when_busy=busy)
        node.serve("abort", TRIGGER, self._told(self._abort))

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
        return told_assembly(self._bus.call(ASSEMBLE, Assemble(strategy=self._strategy), ASSEMBLY_DEADLINE_S))

    def _withdraw(self) -> Said:
        return told_withdrawal(self._bus.call(WITHDRAW, Withdraw(), WITHDRAW_DEADLINE_S))

    def _abort(self) -> Said:
        was_running = self._bus.call(ABORT, AbortAssembly(), ABORT_DEADLINE_S).was_running
        return True, "the assembly was told to end" if was_running else "no assembly was running"

    def close(self) -> None:
        """No further request is carried out."""
        self._motions.close()


def told_assembly(result: AssemblyResult) -> Said:
    """Whether the peg is in, and a line for people."""
    if not result.inserted:
        why = result.failure.value if result.failure is not None else "not inserted"
        return False, f"{why}: {result.failure_detail}" if result.failure_detail else why
    depth_mm, duration_s = result.insertion_depth_m * 1e3, result.motion_s + result.thinking_s
    text = f"inserted, {depth_mm:.1f} mm deep, {duration_s:.1f} s, peak {result.peak_force_n:.1f} N"
    return True, "; ".join([text, *result.warnings])


def told_withdrawal(result: WithdrawResult) -> Said:
    """Whether the peg is out, and a line for people."""
    if not result.withdrawn:
        return False, f"{result.failure.value if result.failure else 'not out'}: {result.failure_detail}"
    return True, f"out, {result.distance_m * 1e3:.1f} mm in {result.motion_s:.1f} s, peak {result.peak_force_n:.1f} N"
