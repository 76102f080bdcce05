"""`python -m services.hardware.rate`: how many of its milliseconds the simulated cell makes in a second of CPU time.

A dwell at home in free air, all of the cell in it: loop, devices, caps, engine. Beside it the engine alone, doing the
same: reference, physics, sensed wrench. One JSON object on standard output; `crosspih bench cell` shows it as a table.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.messages import Dwell
from services.hardware.config import HardwareConfig
from services.hardware.drivers.simulated.engines.protocol import STEP_S
from services.hardware.drivers.simulated.engines.registry import installed_engines, open_engine
from services.hardware.hosting import open_cell

ROUNDS = 5


def steps_per_cpu_second(work: Callable[[], object], steps: int) -> float:
    """The rate of some work that makes so many steps, by the CPU time of this process."""
    began_s = time.process_time()
    work()
    return steps / (time.process_time() - began_s)


def measure_engine(name: str, steps: int) -> dict[str, float]:
    """Steps a second of the cell and of its engine alone: the best of `ROUNDS`, in turns."""
    workcell, config = Workcell(), HardwareConfig.model_validate({"engine": name})
    cell = open_cell(workcell, config, realtime=False)
    engine = open_engine(name, workcell, config.simulated)
    try:
        home = np.asarray(workcell.home_joints_rad, dtype=float)
        still = np.zeros(len(home))
        engine.build(workcell.hole_prior.pose_base_hole(), home)
        dwell = Dwell(duration_s=steps * STEP_S)

        def bare() -> None:
            for _ in range(steps):
                engine.step(home, still, still)
                engine.wrench_sensed()

        rates = {"cell": 0.0, "engine": 0.0}
        for _ in range(ROUNDS):
            rates["cell"] = max(rates["cell"], steps_per_cpu_second(lambda: cell.arm.dwell(dwell), steps))
            rates["engine"] = max(rates["engine"], steps_per_cpu_second(bare, steps))
        return rates
    finally:
        engine.close()
        cell.close()


def main() -> None:
    """Measure each installed engine and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=2000)
    steps = parser.parse_args().steps
    print(json.dumps({name: measure_engine(name, steps) for name in installed_engines()}))


if __name__ == "__main__":
    main()
