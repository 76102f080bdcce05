"""`python -m crosspih_common.collision [CELL.yaml]`: a cell's obstacles, their distances at home, query times."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from crosspih_common.collision import CollisionModel
from crosspih_common.config import Workcell, load_cell
from crosspih_common.errors import ConfigError

SPAN_RAD = 0.4
CALLS = 30


def microseconds(call: Callable[[], object], postures: int = 1) -> float:
    """The median time of a call for each posture, in microseconds."""
    taken = []
    for _ in range(CALLS):
        started = time.perf_counter()
        call()
        taken.append(time.perf_counter() - started)
    return float(np.median(taken)) * 1e6 / postures


def main(arguments: list[str]) -> int:
    """Print it; 1 when the cell's file cannot be used."""
    try:
        workcell = load_cell(arguments[0]).workcell if arguments else Workcell()
        model = CollisionModel(workcell)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return 1
    home = np.asarray(workcell.home_joints_rad, float)
    path = np.array([home, home + SPAN_RAD])
    least = model.clearance(home)
    pose = workcell.pose_base_peg(home)
    print(f"checked against: {', '.join(model.obstacles)}")
    print(f"at home {least.moving} is {least.distance_m * 1e3:.0f} mm from {least.obstacle}")
    print(f"one posture   {microseconds(lambda: model.clearance(home)):6.0f} us")
    postures = model.postures(path)
    print(
        f"along a path  {microseconds(lambda: model.check_path(path), postures):6.0f} us a posture, {postures} postures"
    )
    print(f"peg to zone   {microseconds(lambda: model.tip_clearance_m(pose)):6.0f} us")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
