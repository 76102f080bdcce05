"""Which cell's file and which router a command uses: cheap to import, for commands that only ask who is there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from crosspih_common.bus import DEFAULT_ENDPOINT
from crosspih_common.modules import DEFAULT_CELL


def cell_path() -> str:
    """The cell's file that this command uses."""
    return os.environ.get("CROSSPIH_CELL") or DEFAULT_CELL


@contextmanager
def using_cell(path: Path | None) -> Iterator[None]:
    """CROSSPIH_CELL names that file as long as this lasts, also for what is started; with None nothing is changed."""
    before = os.environ.get("CROSSPIH_CELL")
    if path is not None:
        os.environ["CROSSPIH_CELL"] = str(path.absolute())  # services are started in another folder
    try:
        yield
    finally:
        if before is not None:
            os.environ["CROSSPIH_CELL"] = before
        elif path is not None:
            del os.environ["CROSSPIH_CELL"]


def endpoint() -> str:
    """The router that this command uses."""
    return os.environ.get("CROSSPIH_ENDPOINT") or DEFAULT_ENDPOINT
