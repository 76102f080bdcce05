"""`python -m services.force_torque.offline READINGS --cell CELL [--out FILE]`: bias, weight and centroid without a bus.

READINGS is an IdentifyPayload as JSON; `--out` is the path of the calibration's file. Prints {"found": FtCalibration},
or {"refused": text} where the readings do not fit. Status 2 where a file cannot be read.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from crosspih_common.config import load_cell
from crosspih_common.errors import CommandRefused, CrosspihError
from crosspih_common.messages import IdentifyPayload
from services.force_torque.answering import calibration_message, identified
from services.force_torque.calibration_file import save_calibration
from services.force_torque.config import ForceTorqueConfig


def answer(readings: Path, cell: Path, out: Path | None) -> dict[str, Any]:
    """The data to print. Raises CrosspihError, OSError, ValidationError."""
    command = IdentifyPayload.model_validate_json(readings.read_text(encoding="utf-8"))
    file = load_cell(cell)
    try:
        content, payload = identified(file.workcell, file.section("force_torque", ForceTorqueConfig), command)
    except CommandRefused as refusal:
        return {"refused": str(refusal)}
    if out is not None:
        save_calibration(content, out)
    found = calibration_message(content, payload, "" if out is None else str(out))
    return {"found": found.model_dump(mode="json")}


def main(argv: list[str] | None = None) -> int:
    """Run, and return the exit status."""
    parser = argparse.ArgumentParser()
    parser.add_argument("readings", type=Path)
    parser.add_argument("--cell", type=Path, required=True)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args(argv)
    try:
        said = answer(asked.readings, asked.cell, asked.out)
    except (CrosspihError, OSError, ValidationError) as error:
        print(error, file=sys.stderr)
        return 2
    json.dump(said, sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
