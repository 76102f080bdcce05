"""The operator's client on the bus of a running cell; it also scores, and so reads the simulator's truth."""

from __future__ import annotations

from collections.abc import Callable

from crosspih_common.client.cell import NEEDED, Cell
from crosspih_common.client.connecting import open_bus
from crosspih_common.config import CellFile
from crosspih_common.keys import RESET, TRUTH
from crosspih_common.messages import AssemblyResult, PosePrior, ResetCell, SimulationTruth
from crosspih_common.messages.assembly import AnyStrategy
from crosspih_common.modules import run_folder
from services.operator.cell.check.first import check_before_first
from services.operator.scoring.score import TrialFigures, score

RESET_DEADLINE_S = 120.0  # a busy machine builds a scene slowly


class Session(Cell):
    """See Cell."""

    def __init__(self, connect_timeout_s: float = 5.0) -> None:
        super().__init__(*open_bus(None, None, connect_timeout_s))
        self._truth = self.bus.latest(TRUTH)

    def __enter__(self) -> Session:
        return self

    @property
    def cell(self) -> CellFile:
        """The cell's file."""
        return self.file

    def require_checked_cell(self, say: Callable[[str], None] = lambda text: None) -> None:
        """Before the first assembly since the cell was started: the gentle part of `crosspih cell check`.

        `say` is called with each of its steps. Raises CommandRefused `cell_unfit`, with what is wrong and how to mend
        it.
        """
        folder = run_folder() / self.file.workcell.name
        check_before_first(self.bus, self.file.workcell, self.clock().boot_id, folder, say)

    def new_trial(self, command: ResetCell) -> SimulationTruth:
        """Begin a new trial in the simulated cell; returns what was drawn."""
        return self.bus.call(RESET, command, RESET_DEADLINE_S)

    def truth(self) -> SimulationTruth | None:
        """The latest truth of the simulator; None on a real cell."""
        return self._truth.value()

    def trial(
        self,
        seed: int | None,
        strategy: AnyStrategy,
        record: bool,
        on_begin: Callable[[int], None] = lambda now_ns: None,
        known: PosePrior | None = None,
        on_check: Callable[[str], None] = lambda text: None,
    ) -> tuple[TrialFigures, AssemblyResult]:
        """One assembly, scored. A cell without a simulator is not reset, and figures that need the truth are left out.

        `on_begin` is called with the cell's time when the assembly starts. `known` is the hole's pose for the strategy
        known_pose. `on_check` is called with each step of the first check of a cell that is not simulated.
        """
        truth: SimulationTruth | None = None
        if not self.simulated:
            seed = None
            self.require_checked_cell(on_check)
        if seed is not None:
            truth = self.new_trial(ResetCell(seed=seed))
        name = f"assembly-{strategy.value}" + ("" if seed is None else f"-seed{seed}")
        done = self.assemble(strategy=strategy, known=known, record=record, name=name, on_begin=on_begin)
        if truth is not None:
            # the peg's pose at the end, not at the reset
            now_ns = self.bus.clock.now_ns()
            latest = self._truth.wait_for(lambda sample: sample.stamp_ns >= now_ns, 2.0)
            truth = latest or self._truth.value() or truth
        path = None if done.recording is None else str(done.recording)
        figures = score(self.file.workcell, done.result, truth, wall_s=done.wall_s, recording=path)
        said = {
            "recording_parts": tuple(str(part) for part in done.recording_parts),
            "recording_warnings": done.recording_warnings,
        }
        return figures.model_copy(update=said), done.result


__all__ = ["NEEDED", "Session"]
