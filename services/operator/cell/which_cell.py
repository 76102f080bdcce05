"""Which cell's file and which router a command uses: cheap to import, for commands that only ask which services run."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from crosspih_common.client.defaults import CELL_VARIABLE, cell_path, endpoint


@contextmanager
def using_cell(path: Path | None) -> Iterator[None]:
    """For the length of the block CROSSPIH_CELL names that file, also for processes started in it; with None nothing
    changes.
    """
    before = os.environ.get(CELL_VARIABLE)
    if path is not None:
        os.environ[CELL_VARIABLE] = str(path.absolute())  # services are started in another folder
    try:
        yield
    finally:
        if before is not None:
            os.environ[CELL_VARIABLE] = before
        elif path is not None:
            del os.environ[CELL_VARIABLE]


__all__ = ["cell_path", "endpoint", "using_cell"]
