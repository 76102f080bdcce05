"""`python -m services.inference.cell_refinement RECORDING...`: refines the cell from its past recordings.

It writes JSON lines on standard output: {"doing", "done", "total"} as it goes on, and {"result"} at the end.
`crosspih calibrate refine` runs it.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from crosspih_common.config import load_cell
from crosspih_common.errors import CrosspihError
from services.inference.cell_refinement.assemblies import read_past
from services.inference.cell_refinement.result import refine


def _tell(doing: str, done: int, total: int) -> None:
    print(json.dumps({"doing": doing, "done": done, "total": total}), flush=True)


def main() -> int:
    """Read, fit, print."""
    parser = argparse.ArgumentParser(prog="python -m services.inference.cell_refinement", description=main.__doc__)
    parser.add_argument("recordings", nargs="+", type=Path)
    parser.add_argument("--cell", type=Path, required=True, help="the cell's file that is refined")
    arguments = parser.parse_args()
    try:
        cell = load_cell(arguments.cell)
        found = refine(cell, read_past(cell, arguments.recordings, _tell), _tell)
    except CrosspihError as error:
        print(json.dumps({"error": str(error)}), flush=True)
        return 1
    print(json.dumps({"result": found.as_data(cell)}), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
