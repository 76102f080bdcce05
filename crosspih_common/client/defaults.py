"""The default cell file and router. Cheap to import, for commands that only show something."""

from __future__ import annotations

import os

from crosspih_common.bus import DEFAULT_ENDPOINT
from crosspih_common.modules import DEFAULT_CELL

CELL_VARIABLE = "CROSSPIH_CELL"
ENDPOINT_VARIABLE = "CROSSPIH_ENDPOINT"


def cell_path() -> str:
    """The cell's file: $CROSSPIH_CELL, or the default cell that comes with the package."""
    return os.environ.get(CELL_VARIABLE) or DEFAULT_CELL


def endpoint() -> str:
    """The router: $CROSSPIH_ENDPOINT, or the one that `crosspih up` starts here."""
    return os.environ.get(ENDPOINT_VARIABLE) or DEFAULT_ENDPOINT
