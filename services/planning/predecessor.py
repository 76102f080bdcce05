"""After a planner ended in the middle of an assembly, the next planner finds out the state of arm and peg.

The bus holds all that is known: the arm publishes whose lease it lost, and a dwell gives its pose and the wrench.
Nothing is moved. The peg is taken out on request (by the `crosspih assemble` that had asked for that assembly, or by
`crosspih withdraw`), or on the way home of the next assembly.
"""

from __future__ import annotations

import threading
import time

import numpy as np

from crosspih_common.errors import BusError, CommandRefused
from crosspih_common.messages import LeaseState, Severity
from services.planning.asking import BusPorts
from services.planning.config import PlanningConfig
from services.planning.host import ArmHolder
from services.planning.leaving import NEAR_HOLE_M
from services.planning.ports import AssemblyFailed
from services.planning.run import Run

ASSEMBLY = "assembly"  # how the purpose of such a lease begins
HEAR_S = 10.0
HELD_S = 10.0  # the arm releases a lost holder within this time
LOOK_S = 0.05
HELD = "held"
STILL_IN_USE = frozenset([HELD, "busy"])
_POLL_S = 0.2


def left_in_the_middle(state: LeaseState, planner: str) -> str:
    """The purpose of the lease that was lost during an assembly, by the arm's first lease state after this planner
    started; empty if there was none."""
    for holder, purpose in ((state.lost_holder, state.lost_purpose), (state.holder, state.purpose)):
        if holder == planner and purpose.startswith(ASSEMBLY):
            return purpose
    return ""


class Predecessor:
    """Checks once, in parallel to the planner's commands, and publishes `peg_found` or `arm_found`."""

    def __init__(self, shell: ArmHolder, config: PlanningConfig) -> None:
        self._shell, self._config = shell, config
        self._thread = threading.Thread(target=self._look, name="planning:predecessor", daemon=True)
        self._thread.start()

    def _look(self) -> None:
        shell = self._shell
        state = shell.lease_state.wait_for(lambda _: True, HEAR_S)
        if state is None or shell.closing.is_set() or shell.has_held:
            return
        purpose = left_in_the_middle(state, shell.bus.service)
        if not purpose:
            return
        try:
            code, found = self._found()
        except (AssemblyFailed, BusError, CommandRefused) as error:
            code, found = "peg_unknown", f"where the arm stands was not to be learned: {error}"
        shell.context.event(Severity.WARNING, code, f"the planner before this one ended in its {purpose}; {found}")

    def _found(self) -> tuple[str, str]:
        shell, config = self._shell, self._config
        workcell = shell.context.cell.workcell
        until = time.monotonic() + HELD_S
        while True:
            try:
                with shell.holding("a look at what was left") as lease:
                    run = Run(workcell, config, BusPorts(shell, config, lease), "")
                    run.motion.dwell(LOOK_S)
                break
            except CommandRefused as refusal:
                # until the arm has released the lost holder, and its last motion has ended
                if refusal.code not in STILL_IN_USE or time.monotonic() > until:
                    raise
            shell.closing.wait(_POLL_S)
        nominal = workcell.hole_prior.pose_base_hole()
        x, y, z = nominal.inverse().apply(run.motion.pose_base_peg.apply([0.0, 0.0, workcell.peg.shape().tip_m]))
        if np.hypot(x, y) >= NEAR_HOLE_M or z <= -config.approach_m:
            return "arm_found", "the arm stands clear of the hole"
        past = f"{abs(z) * 1e3:.0f} mm {'past' if z > 0.0 else 'before'}"
        return "peg_found", (
            f"the peg's tip stands {past} the hole's face as drawn, with {run.counts.peak_force_n:.1f} N on it: "
            "`crosspih withdraw`, or the next assembly, takes it out"
        )
