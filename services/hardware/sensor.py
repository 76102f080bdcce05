"""`python -m services.hardware.sensor --cell my-cell.yaml`: the force/torque sensor of a cell alone, as its driver
gives it.

It opens nothing else and moves nothing: a first look at a sensor, and a measurement of how well it comes. It prints how
many samples came, how regularly, how late they were heard, and what they say; with `--json` as one JSON object. What
the driver tells of itself goes to standard error. Status 1 where nothing came.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import sys
import time
from typing import Any

import numpy as np

from crosspih_common.config import load_cell
from crosspih_common.errors import ConfigError
from services.hardware.config import HardwareConfig
from services.hardware.drivers.registry import open_devices
from services.hardware.protocols import Devices, WrenchDevice

CYCLE_S = 0.002  # as an arm of 500 Hz asks


def look(wrench: WrenchDevice, seconds: float, host_stamped: bool) -> dict[str, Any]:
    """What a sensor gave in a time, figures by name."""
    stamps: list[int] = []
    rows: list[Any] = []
    ages_s: list[float] = []
    wrench.read()
    began_s, cpu_s = time.monotonic(), time.process_time()
    while time.monotonic() - began_s < seconds:
        got = wrench.read()
        now_ns = time.monotonic_ns()
        if len(got.stamps_ns):
            stamps += got.stamps_ns.tolist()
            rows.append(got.wrenches)
            ages_s.append((now_ns - int(got.stamps_ns[-1])) * 1e-9)
        time.sleep(CYCLE_S)
    cpu_share = (time.process_time() - cpu_s) / (time.monotonic() - began_s)
    found: dict[str, Any] = {"samples": len(stamps), "period_s": wrench.period_s, "cpu_share": round(cpu_share, 4)}
    if len(stamps) > 1:
        steps_s = np.diff(np.array(stamps)) * 1e-9
        wrenches = np.concatenate(rows)
        found["samples_a_second"] = round((len(stamps) - 1) / ((stamps[-1] - stamps[0]) * 1e-9), 3)
        found["step_s"] = {"median": float(np.median(steps_s)), "longest": float(steps_s.max())}
        found["mean"] = wrenches.mean(axis=0).round(4).tolist()
        found["sd"] = wrenches.std(axis=0).round(5).tolist()
    if ages_s and host_stamped:
        found["newest_age_s"] = dict(
            zip(("p50", "p95", "max"), np.percentile(ages_s, [50, 95, 100]).round(6).tolist(), strict=True)
        )
    counts, clock = getattr(wrench, "counts", None), getattr(wrench, "clock", None)
    if dataclasses.is_dataclass(counts) and not isinstance(counts, type):
        found["counts"] = dataclasses.asdict(counts)
    if clock is not None:
        found["stamps_within_s"], found["drift_ppm"] = clock.uncertainty_s, clock.drift_ppm
        found["drift_within_ppm"], found["clock_restarts"] = clock.drift_uncertainty_ppm, clock.restarts
    return found


def main() -> int:
    """Open, look, print."""
    parser = argparse.ArgumentParser(prog="python -m services.hardware.sensor", description=__doc__)
    parser.add_argument("--cell", default=os.environ.get("CROSSPIH_CELL"), help="the cell's YAML file")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    if not arguments.cell:
        parser.error("--cell: name the cell's file, or set CROSSPIH_CELL")
    devices: Devices | None = None
    try:
        cell = load_cell(arguments.cell)
        config = cell.section("hardware", HardwareConfig)
        devices = open_devices(cell.workcell, config, frozenset({"force_torque"}), True)
        assert devices.wrench is not None
        found = look(devices.wrench, arguments.seconds, devices.host_stamped)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return 2
    finally:
        if devices is not None:
            devices.close()
    if arguments.json:
        print(json.dumps(found))
    else:
        for name, value in found.items():
            print(f"{name:18} {value}")
    return 0 if found["samples"] else 1


if __name__ == "__main__":
    sys.exit(main())
