"""A cell without a simulator must pass its check after each start before it may be asked for an assembly."""

from __future__ import annotations

import json
from pathlib import Path

from crosspih_common.errors import CommandRefused
from crosspih_common.modules import run_folder

FILE = "cell-check.json"


def checked_boot(folder: Path) -> str | None:
    """The boot id of the cell that passed its check, by the file in `folder`; None if there is none."""
    try:
        said = json.loads((folder / FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return said.get("boot_id") if isinstance(said, dict) else None


def note_checked(folder: Path, boot_id: str) -> None:
    """Record in `folder` that this boot of the cell passed its check."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FILE).write_text(json.dumps({"boot_id": boot_id}) + "\n", encoding="utf-8")


def require_checked(cell: str, boot_id: str) -> None:
    """Raises CommandRefused `cell_unfit` where the present boot of a cell has not passed its check on this machine."""
    if checked_boot(run_folder() / cell) != boot_id:
        raise CommandRefused(
            "cell_unfit", f"{cell} was not checked since it was started; `crosspih cell check` does it, then try again"
        )
