"""First contacts and pushes per second, against the plain method.

The plain method is the separating-axis test over every axis of every pair of pieces (`separating_axes`); it is timed in
the same run. Rates are per wall time; on a machine with other load, the rates per processor time are more meaningful.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from services.inference.mechanics import PairTables, SurfacePair, first_contact, first_contacts, push
from services.inference.mechanics.separating_axes import AxisTables, first_contacts_by_axes

BATCH = 4096
PLAIN_BATCH = 256
PUSHES = 512
OUTLINES = ("cross", "square", "triangle", "hexagon", "star", "spline", "keyway", "round")
COMPLIANCE = np.diag([1e-5] * 3 + [1e-3] * 3)
Rate = tuple[float, float, float]


def poses(tip_m: float, count: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Peg poses (N, 3, 3), (N, 3) m in front of the hole and directions (N, 3), spread as in a trial."""
    rotation = np.swapaxes(rotation_from_error_angles(rng.uniform(-0.1, 0.1, (count, 3))), 1, 2)
    tip = np.column_stack([rng.uniform(-0.01, 0.01, (count, 2)), rng.uniform(-0.015, -0.005, count)])
    return rotation, tip - rotation @ np.array([0.0, 0.0, tip_m]), np.tile([0.0, 0.0, 1.0], (count, 1))


def rates(outline: str, seconds: float, seed: int) -> dict[str, Rate]:
    """For each method the number of calls, and their wall and processor time, s."""
    cell = Workcell.model_validate({"peg": {"outline": outline}} if outline != "cross" else {})
    peg = cell.peg.shape()
    tables = PairTables.of(peg, cell.hole.shape(peg))
    axes, surfaces = AxisTables.of(tables), SurfacePair.of(tables)
    rotation, translation, direction = poses(peg.tip_m, BATCH, np.random.default_rng(seed))
    few = slice(0, PUSHES)
    plain = slice(0, PLAIN_BATCH if len(tables.hole) < 20 else 4)
    methods: dict[str, tuple[int, Callable[[], Any]]] = {
        "plain": (
            len(rotation[plain]),
            lambda: first_contacts_by_axes(axes, rotation[plain], translation[plain], direction[plain]),
        ),
        "first": (BATCH, lambda: first_contact(tables, rotation, translation, direction)),
        "every_pair": (BATCH, lambda: first_contacts(tables, rotation, translation, direction)),
        "push": (
            PUSHES,
            lambda: push(tables, surfaces, rotation[few], translation[few], direction[few], 2e-4, COMPLIANCE, 0.1),
        ),
    }
    found: dict[str, Rate] = {}
    for name, (size, run) in methods.items():
        run()
        wall, busy, done = time.perf_counter(), time.process_time(), 0
        while done == 0 or time.perf_counter() - wall < seconds:
            run()
            done += size
        found[name] = (float(done), time.perf_counter() - wall, time.process_time() - busy)
    return found


def measured(outline: str, seconds: float, processes: int, seed: int) -> dict[str, Any]:
    """Rates of all processes together: per second of wall time, and per second of processor time times the
    processes."""
    jobs = [(outline, seconds, seed + index) for index in range(processes)]
    if processes == 1:
        parts = [rates(*jobs[0])]
    else:
        with multiprocessing.get_context("spawn").Pool(processes) as pool:
            parts = pool.starmap(rates, jobs, chunksize=1)
    row: dict[str, Any] = {"peg": outline, "processes": processes}
    for name in parts[0]:
        row[f"{name}_per_s"] = round(sum(part[name][0] / part[name][1] for part in parts))
        row[f"{name}_per_cpu_s"] = round(sum(part[name][0] / part[name][2] for part in parts))
    row["ratio_to_plain"] = round(row["first_per_cpu_s"] / max(row["plain_per_cpu_s"], 1e-9), 1)
    return row
