"""`python -m services.hardware.drivers.simulated.engines.rate`: how many steps a second each installed engine makes.

One JSON object on standard output. A step is one of the cell's milliseconds as the cell takes it: reference, physics,
sensed wrench. `crosspih bench engines` shows it as a table.
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

from crosspih_common.arm.inverse import nearest
from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.protocol import Physics
from services.hardware.drivers.simulated.engines.registry import installed_engines, open_engine

# where the peg is against the hole, and where the motor side then goes, m along x, y, z of the hole
SCENES: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "free": ((0.0, 0.0, -0.1), (0.0, 0.0, -0.095)),
    "pressed on a wall of the bore": ((0.0, 0.0, -0.020), (0.0004, 0.0, -0.020)),
}
ROUNDS = 4


def _references(workcell: Workcell, scene: str) -> tuple[Array, Array]:
    start, end = (
        workcell.hole_prior.pose_base_hole() @ Pose.from_translation(place) @ workcell.pose_flange_peg().inverse()
        for place in SCENES[scene]
    )
    joints = nearest(workcell.arm(), start, workcell.home_joints_rad)
    return joints, nearest(workcell.arm(), end, joints)


def steps_per_second(engine: Physics, workcell: Workcell, scene: str, steps: int) -> float:
    """The rate of one engine in one of `SCENES`, once the motor side has come to its end."""
    start, end = _references(workcell, scene)
    engine.build(workcell.hole_prior.pose_base_hole(), start)
    still = np.zeros(len(start))
    for step in range(1, 201):
        engine.step(start + (end - start) * step / 200.0, still, still)
    began = time.perf_counter()
    for _ in range(steps):
        engine.step(end, still, still)
        engine.wrench_sensed()
    return steps / (time.perf_counter() - began)


def measure(steps: int) -> dict[str, dict[str, float]]:
    """Steps a second by engine and scene: the best of `ROUNDS`, in turns, so that a busy moment hits all alike."""
    workcell, config = Workcell(), SimulatedConfig()
    engines = {name: open_engine(name, workcell, config) for name in installed_engines()}
    rates = {name: dict.fromkeys(SCENES, 0.0) for name in engines}
    try:
        for _ in range(ROUNDS):
            for scene in SCENES:
                for name, engine in engines.items():
                    rate = steps_per_second(engine, workcell, scene, steps)
                    rates[name][scene] = max(rates[name][scene], rate)
    finally:
        for engine in engines.values():
            engine.close()
    return rates


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=2000)
    print(json.dumps(measure(parser.parse_args().steps)))


if __name__ == "__main__":
    main()
