"""`python -m services.hardware.rate`: how many of its milliseconds the simulated cell makes in a second of CPU time.

A dwell at home in free air, and an admittance move from there, with all of the cell in it: control, devices, caps,
sensor, engine, and what it publishes, encoded and handed to a bus in memory. Beside it the engine alone at rest:
reference, physics, sensed wrench. One JSON object on standard output; `crosspih bench cell` shows it as a table.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import numpy as np

from crosspih_common.bus import Bus
from crosspih_common.bus.memory import MemoryHub
from crosspih_common.config import Workcell
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import AdmittanceMove, Dwell, SetPayload
from crosspih_common.messages.base import floats
from services.hardware.config import HardwareConfig
from services.hardware.drivers.simulated.engines.protocol import STEP_S
from services.hardware.drivers.simulated.engines.registry import installed_engines, open_engine
from services.hardware.hosting import HostedCell, open_cell
from services.hardware.shells.arm import ArmShell

ROUNDS = 5
TRAVEL_M = 0.04


def steps_per_cpu_second(work: Callable[[], object], steps: int) -> float:
    """The rate of some work that makes so many steps, by the CPU time of this process."""
    began_s = time.process_time()
    work()
    return steps / (time.process_time() - began_s)


def publishing(cell: HostedCell, workcell: Workcell) -> ArmShell:
    """The cell's arm on a bus in memory, streaming as it does on a real one."""
    return ArmShell(cell.arm, Bus(MemoryHub().transport(), workcell.name, "hardware"), cell.realtime, True)


def payload_of(workcell: Workcell, config: HardwareConfig) -> SetPayload:
    """What hangs on the simulated sensor, which a service would have to calibrate: nothing moves without it."""
    sensor, gravity = config.simulated.force_torque, np.asarray(workcell.gravity_base_m_s2, dtype=float)
    size = float(np.linalg.norm(gravity))
    return SetPayload(
        bias=sensor.bias, weight_n=size * sensor.payload_kg, centroid_ft_m=sensor.payload_centroid_m,
        gravity_base=floats(gravity / size),
    )  # fmt: skip


def admittance_move(axis_base: Array, steps: int) -> AdmittanceMove:
    """Some centimetres along an axis (3,) in free air, ended after so many steps at the latest."""
    return AdmittanceMove(
        direction_base=floats(axis_base), speed_m_s=min(0.1, TRAVEL_M / (steps * STEP_S)), travel_m=2.0 * TRAVEL_M,
        timeout_s=steps * STEP_S,
    )  # fmt: skip


def measure_engine(name: str, steps: int) -> dict[str, float]:
    """Steps a second of the cell at rest and in a move, and of its engine alone: the best of `ROUNDS`, in turns."""
    workcell, config = Workcell(), HardwareConfig.model_validate({"engine": name})
    cell = open_cell(workcell, config, realtime=False)
    shell = publishing(cell, workcell)
    engine = open_engine(name, workcell, config.simulated)
    try:
        home = np.asarray(workcell.home_joints_rad, dtype=float)
        still = np.zeros(len(home))
        engine.build(workcell.hole_prior.pose_base_hole(), home)
        axis = workcell.pose_base_peg(home).rotation[:, 2]
        cell.arm.set_payload(payload_of(workcell, config))
        dwell = Dwell(duration_s=steps * STEP_S)

        def bare() -> None:
            for _ in range(steps):
                engine.step(home, still, still)
                engine.wrench_sensed()

        rates = {"cell": 0.0, "move": 0.0, "engine": 0.0}
        for index in range(ROUNDS):
            move = admittance_move(-axis if index % 2 == 0 else axis, steps)
            rates["cell"] = max(rates["cell"], steps_per_cpu_second(lambda: cell.arm.dwell(dwell), steps))
            rates["engine"] = max(rates["engine"], steps_per_cpu_second(bare, steps))
            began_ns, began_s = cell.arm.now_ns(), time.process_time()
            cell.arm.admittance_move(move)
            made = (cell.arm.now_ns() - began_ns) * 1e-9 / STEP_S
            rates["move"] = max(rates["move"], made / (time.process_time() - began_s))
        return rates
    finally:
        shell.close()
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
