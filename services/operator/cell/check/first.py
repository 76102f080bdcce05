"""The gentle part of the checks, before the first assembly of a cell that is not simulated, once each
time it starts.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from crosspih_common.bus import Bus
from crosspih_common.client.checked import checked_boot, note_checked
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.holding.soundness import UNFIT
from services.operator.cell.check.measuring import CheckManner, check_cell
from services.operator.cli.rows import wrong_ones

GENTLE = CheckManner(provoking=False, camera_needed=False)  # an assembly by force alone needs no camera


def check_before_first(
    bus: Bus,
    workcell: Workcell,
    boot_id: str,
    folder: Path,
    say: Callable[[str], None] = lambda text: None,
    manner: CheckManner = GENTLE,
) -> bool:
    """Check the cell unless the file in `folder` says that its present boot was checked; returns whether it was checked
    now.

    Raises CommandRefused `cell_unfit`, naming what fails and how to mend it.
    """
    if checked_boot(folder) == boot_id:
        return False
    wrong = wrong_ones(check_cell(bus, workcell, manner, say))
    if wrong:
        listed = "; ".join(f"{one.name}: {one.found} -> {one.mend}" for one in wrong)
        raise CommandRefused(UNFIT, f"{listed}. `crosspih cell check` shows all")
    note_checked(folder, boot_id)
    return True
