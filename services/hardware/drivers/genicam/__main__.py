"""`python -m services.hardware.drivers.genicam`: which cameras answer; with `--cell` the pair is opened and tried.

Prints for each camera what it is and for a number of pairs how long they took, how far apart the exposures began by the
cameras' own stamps, and what was lost on the way. The exit status is 1 when a setting or a pair was refused.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from crosspih_common.aravis import load
from crosspih_common.config import load_cell
from crosspih_common.errors import CrosspihError
from services.hardware.config import HardwareConfig
from services.hardware.drivers.genicam.discovery import discovered
from services.hardware.drivers.genicam.opening import open_pair
from services.hardware.drivers.genicam.stereo import GenicamPair
from services.hardware.drivers.registry import OpenRequest


def tried(pair: GenicamPair, captures: int) -> str:
    """Take pairs; what they say in lines. Raises CommandRefused."""
    took_s, skews_s, uncertain_s = [], [], []
    for _ in range(captures):
        asked_s = time.monotonic()
        pair.capture(1.0, 0)
        took_s.append(time.monotonic() - asked_s)
        if pair.skew is not None:
            skews_s.append(abs(pair.skew.skew_s))
            uncertain_s.append(pair.skew.uncertainty_s)
    took_ms, skews_ms = np.array(took_s) * 1e3, np.array(skews_s) * 1e3
    lines = [
        f"{captures} pairs: {np.median(took_ms):.1f} ms from asking to both pictures (median), {took_ms.max():.1f} at "
        f"most; exposure {pair.exposure_s * 1e3:g} ms",
        f"apart by {np.median(skews_ms):.3f} ms (median), {skews_ms.max():.3f} at most, known to "
        f"+-{max(uncertain_s) * 1e3:.3f} ms; {pair.exposed_apart} pairs thrown away for it",
    ]
    for camera in (pair.left, pair.right):
        losses = camera.losses
        lines.append(
            f"{camera.side}: {losses.pictures} pictures, {losses.incomplete} incomplete, {losses.packets_missing} "
            f"packets missing, {losses.packets_resent} sent again, {losses.reconnects} times found again"
        )
    return "\n".join(lines)


def main() -> int:
    """List, or try."""
    parser = argparse.ArgumentParser(prog="genicam", description="GenICam cameras: which answer, how a pair does.")
    parser.add_argument("--cell", type=Path, help="a cell's file with hardware.genicam")
    parser.add_argument("--captures", type=int, default=20)
    given = parser.parse_args()
    try:
        if given.cell is None:
            cameras = discovered(load())
            print("\n".join(map(str, cameras)) or "no camera answers")
            return 0
        cell = load_cell(given.cell)
        config = cell.section("hardware", HardwareConfig)
        pair = open_pair(OpenRequest(cell.workcell, config, frozenset({"camera"}), realtime=True))
        try:
            print(tried(pair, given.captures))
        finally:
            pair.close()
    except CrosspihError as error:
        print(f"genicam: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
