"""Does the tasks of a cell for any executor: it keeps its cell as long as the tasks need the same one."""

from __future__ import annotations

import time
import traceback
from dataclasses import dataclass
from typing import Any

from crosspih_common.errors import CrosspihError
from deploy.launcher import LauncherError
from services.operator.assembly.session import Session
from services.operator.bench.cells.own_cell import CellTask, OwnCell


@dataclass(frozen=True)
class Outcome:
    """The outcome of a task: a result, or in `lost` the reason why there is none. `start_s` is the time to start the
    cell.
    """

    result: Any = None
    lost: str | None = None
    start_s: float = 0.0


class CellWorker:
    """Owns one cell at a time. A task that fails ends its cell too: the next one gets a new stack."""

    def __init__(self, index: int) -> None:
        self._index = index
        self._cell: OwnCell | None = None
        self._session: Session | None = None
        self._task: CellTask | None = None

    def run(self, task: CellTask) -> Outcome:
        """Do a task; never raises for failures of a cell."""
        started = time.monotonic()
        start_s = 0.0
        try:
            if self._session is None or not task.same_cell(self._task):
                self.close()
                self._cell, self._task = OwnCell(self._index, task), task
                self._session = self._cell.start()
                start_s = time.monotonic() - started
            return Outcome(task.work(self._session, task.payload), start_s=start_s)
        except (CrosspihError, LauncherError) as error:
            said = str(error)
        except Exception:
            said = traceback.format_exc(limit=-4).strip()
        words = self._cell.last_words() if self._cell is not None else ""
        self.close()
        return Outcome(lost=f"{said} ({words})" if words else said)

    def close(self) -> None:
        """Stop the cell, if there is one."""
        cell, self._cell, self._session, self._task = self._cell, None, None, None
        if cell is not None:
            cell.close()
