"""What a distance costs from Python and how right it is, by coal and, where it is installed, by python-fcl.

    python -m tests.collision.measure_libraries

Random poses of a capsule against a box, whose distance is known but for one bounded search along the capsule's line.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib import import_module, util
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from crosspih_common.geometry.pose import Array

RADIUS_M, LENGTH_M = 0.05, 0.3
SIZE_M = np.array([0.2, 0.3, 0.1])
POSES = 2000


def known_m(rotation: Array, place_m: Array) -> float:
    """The distance of the capsule from the box, m; convex along the line, so that a bounded search finds it."""

    def gap(along_m: float) -> float:
        beyond = np.abs(place_m + along_m * rotation[:, 2]) - SIZE_M / 2
        return float(np.linalg.norm(np.maximum(beyond, 0.0)))

    found = minimize_scalar(gap, bounds=(-LENGTH_M / 2, LENGTH_M / 2), method="bounded", options={"xatol": 1e-10})
    return float(found.fun) - RADIUS_M


def by_coal() -> Callable[[Array, Array], float]:
    coal: Any = import_module("coal")
    box, capsule = coal.Box(*SIZE_M), coal.Capsule(RADIUS_M, LENGTH_M)
    distance, request, still = coal.ComputeDistance(box, capsule), coal.DistanceRequest(), coal.Transform3s()

    def ask(rotation: Array, place_m: Array) -> float:
        _ = box, capsule  # the library only points at them
        return float(distance(still, coal.Transform3s(rotation, place_m), request, coal.DistanceResult()))

    return ask


def by_fcl() -> Callable[[Array, Array], float]:
    fcl: Any = import_module("fcl")
    box, capsule = fcl.CollisionObject(fcl.Box(*SIZE_M)), fcl.Capsule(RADIUS_M, LENGTH_M)
    moving, request = fcl.CollisionObject(capsule), fcl.DistanceRequest(enable_signed_distance=True)

    def ask(rotation: Array, place_m: Array) -> float:
        moving.setTransform(fcl.Transform(rotation, place_m))
        return float(fcl.distance(box, moving, request, fcl.DistanceResult()))

    return ask


def main() -> None:
    """Print one line a library."""
    rng = np.random.default_rng(0)
    turns = Rotation.random(POSES, random_state=0).as_matrix()
    places = rng.uniform(-0.6, 0.6, (POSES, 3))
    known = np.array([known_m(turn, place) for turn, place in zip(turns, places, strict=True)])
    apart = known > 0.0
    for module, make in (("coal", by_coal), ("fcl", by_fcl)):
        if util.find_spec(module) is None:
            print(f"{module}: not installed")
            continue
        ask = make()
        started = time.perf_counter()
        found = np.array([ask(turn, place) for turn, place in zip(turns, places, strict=True)])
        took_us = (time.perf_counter() - started) / POSES * 1e6
        print(f"{module}: off by at most {np.abs(found - known)[apart].max():.1e} m, {took_us:.1f} us a query")


if __name__ == "__main__":
    main()
