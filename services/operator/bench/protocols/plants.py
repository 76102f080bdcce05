"""A simulated cell that can be reached by its devices' own protocols alone, and the cell's file that reaches it so.

Physics, noise and the hole's place come from the simulated cell, in the peers' processes; the cell that assembles has
no simulator: no truth, no reset, and joints, wrenches and pictures from the network.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import yaml

import deploy
from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import NoService
from crosspih_common.keys import CAMERA_CALIBRATION
from crosspih_common.messages import SimulationTruth
from services.operator.bench.own_cell import free_port
from services.operator.bench.protocols.peers import READY_S, Peer

LEFT, RIGHT = "127.0.0.2", "127.0.0.3"
UR_HOST = "127.0.0.1"
CAMERAS_CELL = "protocol-cameras"
EXPOSURE_S = 0.02


class Way(str, Enum):
    """Which protocols are between the services and the cell."""

    UR = "ur"  # RTDE, Net F/T, GigE Vision
    ROS2 = "ros2"  # ros2_control's topics, WrenchStamped, Image


@dataclass(frozen=True, slots=True)
class Plant:
    """A cell behind its protocols: the content of the cell's file that reaches it, and what only the bench may ask."""

    content: dict[str, Any]
    arm: Peer

    def truth(self) -> SimulationTruth:
        """Where hole and peg are: for scoring. Raises NoService."""
        return SimulationTruth.model_validate_json(self.arm.ask("truth"))

    def cycles(self) -> tuple[int, int]:
        """How many cycles the arm's other end has made, and how many of them late."""
        said = json.loads(self.arm.ask("state"))
        return int(said["cycles"]), int(said["late_cycles"])


def base_content(way: Way) -> dict[str, Any]:
    """The cell that stands behind the protocols."""
    name = "ur5e" if way is Way.UR else "default"
    file = Path(deploy.__file__).resolve().parent / "cells" / f"{name}.yaml"
    return dict(yaml.safe_load(file.read_text(encoding="utf-8")))


@contextmanager
def open_plant(way: Way, seed: int, folder: Path) -> Iterator[Plant]:
    """Start the cell of a seed behind its protocols. Raises NoService when one of its processes does not come up."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    environment = _environment(endpoint)
    with ExitStack() as stack:
        stack.enter_context(Peer("router", ["services.router", "--endpoint", endpoint], environment, folder))
        _wait_for(endpoint)
        open_way = _open_ur if way is Way.UR else _open_ros2
        yield open_way(stack, seed, folder, endpoint, environment)


def _environment(endpoint: str) -> dict[str, str]:
    root = str(Path(deploy.__file__).resolve().parent.parent)
    path = os.pathsep.join(dict.fromkeys([root, *os.environ.get("PYTHONPATH", root).split(os.pathsep)]))
    kept = {name: value for name, value in os.environ.items() if not name.startswith("CROSSPIH_")}
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return {**kept, **threads, "PYTHONPATH": path, "CROSSPIH_ENDPOINT": endpoint, "CROSSPIH_SPEED": "realtime"}


def _wait_for(endpoint: str) -> None:
    open_zenoh(endpoint, READY_S).close()


def _written(folder: Path, name: str, content: dict[str, Any]) -> str:
    path = folder / name
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return str(path)


def _with_hardware(content: dict[str, Any], hardware: dict[str, Any], name: str | None = None) -> dict[str, Any]:
    cell = dict(content["cell"])
    if name is not None:
        cell["name"] = name
    return {**content, "cell": cell, "hardware": {**content.get("hardware", {}), **hardware}}


def _open_ur(stack: ExitStack, seed: int, folder: Path, endpoint: str, environment: dict[str, str]) -> Plant:
    """The arm behind a Universal Robots controller, its sensor behind a Net F/T box, its cameras on GigE Vision."""
    base = base_content(Way.UR)
    ports = [free_port(), free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)]
    box = Peer(
        "ati",
        ["services.operator.bench.protocols.ati", "--http-port", str(ports[0]), "--rdt-port", str(ports[1]),
         "--feed-port", str(ports[2]), "--drift-ppm", "40"],
        environment, folder,
    )  # fmt: skip
    stack.enter_context(box).line("ready")
    behind = _written(folder, "plant.yaml", _with_hardware(base, {"simulated": {"seed": seed}}))
    arm = Peer(
        "ur",
        ["services.hardware.peers.ur", "--address", UR_HOST, "--cell", behind, "--feed", f"127.0.0.1:{ports[2]}"],
        environment, folder,
    )  # fmt: skip
    stack.enter_context(arm).line("ready")
    arm.ask(f"seed {seed}")
    calibration = _open_cameras(stack, base, seed, folder, endpoint, environment)
    content = _with_hardware(
        base,
        {
            "driver": "ur",
            "drivers": {"force_torque": "ati", "camera": "genicam"},
            "ur": {"host": UR_HOST, "silence_s": 0.5},
            "ati": {"host": "127.0.0.1", "http_port": ports[0], "rdt_port": ports[1]},
            "genicam": {
                "left": LEFT,
                "right": RIGHT,
                "calibration": calibration,
                "exposure_s": EXPOSURE_S,
                "frame_wait_s": 30.0,
            },
            # mass and stiffness of the simulated cell behind it: what one would measure there (docs/safety.md)
            "limits": {
                "moved_mass_kg": 7.3,
                "contact_stiffness_n_m": 7.3e6,
                "sensor_delay_s": 0.036,
                # both ends share one machine here, and neither is a real-time program
                "missed_cycles": 1000,
            },
        },
    )
    return Plant(content, arm)


def _open_cameras(
    stack: ExitStack, base: dict[str, Any], seed: int, folder: Path, endpoint: str, environment: dict[str, str]
) -> str:
    """The simulated cell's cameras, and two of GigE Vision that show what they render; the calibration's file."""
    content = _with_hardware(base, {"driver": "simulated", "simulated": {"seed": seed}}, CAMERAS_CELL)
    file = _written(folder, "cameras.yaml", content)
    own = {**environment, "CROSSPIH_CELL": file}
    stack.enter_context(Peer("cameras", ["services.hardware", "--devices", "camera"], own, folder))
    with contextlib.closing(Bus(open_zenoh(endpoint, READY_S), CAMERAS_CELL, "operator")) as bus:
        told = bus.latest(CAMERA_CALIBRATION).wait_for(lambda _: True, READY_S)
    if told is None:
        raise NoService("cameras: the simulated cameras did not come up")
    path = folder / "cameras-calibration.json"
    path.write_text(told.model_dump_json(), encoding="utf-8")
    shown = Peer(
        "genicam",
        ["services.operator.bench.protocols.genicam", "--left", LEFT, "--right", RIGHT, "--from-cell", CAMERAS_CELL,
         "--endpoint", endpoint, "--exposure", str(EXPOSURE_S), "--clock-offset", "3.7"],
        environment, folder,
    )  # fmt: skip
    stack.enter_context(shown).line("cameras:")
    return str(path)


def _open_ros2(stack: ExitStack, seed: int, folder: Path, endpoint: str, environment: dict[str, str]) -> Plant:
    """The arm, its sensor and its cameras behind ROS 2 topics."""
    base = base_content(Way.ROS2)
    rate_hz = 250
    hardware = {
        "driver": "ros2",
        "ros2": {
            "endpoint": endpoint,
            "arm": {"rate_hz": rate_hz, "joint_names": [f"joint_{number}" for number in range(1, 7)]},
            "force_torque": {"rate_hz": rate_hz},
        },
        "limits": {
            "moved_mass_kg": 7.3, "contact_stiffness_n_m": 7.3e6, "sensor_delay_s": 0.03, "missed_cycles": 1000,
        },
    }  # fmt: skip
    content = _with_hardware(base, hardware)
    behind = _with_hardware(content, {"simulated": {"period_s": 1.0 / rate_hz, "seed": seed}})
    file = _written(folder, "plant.yaml", behind)
    arm = Peer("ros2_control", ["services.hardware.peers.ros2", "--cell", file], environment, folder)
    stack.enter_context(arm).line("peer:")
    shown = Peer(
        "ros2_cameras", ["services.hardware.peers.ros2", "--cell", file, "--devices", "camera"], environment, folder
    )
    stack.enter_context(shown).line("peer:")
    return Plant(content, arm)


def needs_private_network(way: Way) -> bool:
    """Whether it needs addresses that the machine may not have."""
    return way is Way.UR and sys.platform == "linux"
