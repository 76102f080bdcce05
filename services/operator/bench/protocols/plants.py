"""A simulated cell that is reached only by its devices' own protocols, and the cell's file that reaches it.

Physics, noise and the hole's place come from the simulated cell, in the peers' processes. The assembling cell has no
simulator: no truth, no reset, and joints, wrenches and pictures only from the network.
"""

from __future__ import annotations

import contextlib
import json
import os
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
from crosspih_common.geometry import Pose
from crosspih_common.keys import CAMERA_CALIBRATION
from crosspih_common.messages import PoseData, SimulationTruth
from crosspih_common.plain_yaml import text_of_file, yaml_of
from services.operator.bench.cells.conditions import merged
from services.operator.bench.cells.own_cell import free_port
from services.operator.bench.protocols.hidden import behind, held_by_hand
from services.operator.bench.protocols.peers import READY_S, Peer

# the addresses of docs/hardware/in-a-day.md
ARM, SENSOR, LEFT, RIGHT = ADDRESSES = "192.168.0.10", "192.168.0.11", "192.168.0.12", "192.168.0.13"
FEED_PORT, SEEN_PORT = 49160, 49170
# values as measured in the simulated cell behind the protocols (docs/safety.md); both ends share one machine on which
# neither is a real-time program, and rendering takes longer than a sensor's exposure
HERE = {
    "ur": {"silence_s": 0.5},
    "genicam": {"frame_wait_s": 30.0},
    "limits": {"moved_mass_kg": 7.3, "contact_stiffness_n_m": 7.3e6, "missed_cycles": 10000, "sensor_timeout_s": 0.5},
}
CAMERAS_CELL = "protocol-cameras"
EXPOSURE_S = 0.02


class ProtocolWay(str, Enum):
    """The protocols between the services and the cell."""

    UR = "ur"  # RTDE, Net F/T, GigE Vision
    ROS2 = "ros2"  # ros2_control's topics, WrenchStamped, Image


@dataclass(frozen=True, slots=True)
class Plant:
    """A cell behind its protocols: the content of the cell's file that reaches it, and queries that only the bench may
    make.
    """

    content: dict[str, Any]
    arm: Peer
    behind: dict[str, Any]

    def truth(self) -> SimulationTruth:
        """The poses of hole and peg, the peg as its holder has it: for scoring. Raises NoService."""
        truth = SimulationTruth.model_validate_json(self.arm.ask("truth"))
        shift = (self.behind["hardware"]["simulated"].get("truth") or {}).get("peg_shift_m")
        if shift is None:
            return truth
        held = truth.pose_base_peg.pose() @ Pose.from_translation(shift)
        return truth.model_copy(update={"pose_base_peg": PoseData.of(held)})

    def cycles(self) -> tuple[int, int]:
        """The simulated arm's cycles so far, and how many of them were late."""
        said = json.loads(self.arm.ask("state"))
        return int(said["cycles"]), int(said["late_cycles"])


def base_content(way: ProtocolWay, hides: int | None = None) -> dict[str, Any]:
    """The cell that stands behind the protocols; with hidden errors it is the UR5e's, for which the calibrations were
    found.
    """
    name = "ur5e" if way is ProtocolWay.UR or hides is not None else "default"
    file = Path(deploy.__file__).resolve().parent / "cells" / f"{name}.yaml"
    return dict(yaml_of(text_of_file(file)))


@contextmanager
def open_plant(way: ProtocolWay, seed: int, folder: Path, hides: int | None = None) -> Iterator[Plant]:
    """Start the cell of a seed behind its protocols; `hides` is the seed of the differences from its file (hidden.py),
    None for no difference. Raises NoService when one of its processes does not come up.
    """
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    environment = _environment(endpoint)
    with ExitStack() as stack:
        stack.enter_context(Peer("router", ["services.router", "--endpoint", endpoint], environment, folder))
        _wait_for(endpoint)
        open_way = _open_ur if way is ProtocolWay.UR else _open_ros2
        base = base_content(way, hides)
        real = merged(behind(base, hides), {"hardware": {"simulated": {"seed": seed}}})
        yield open_way(_Opening(stack, base, real, hides, folder, endpoint, environment))


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


@dataclass(frozen=True, slots=True, eq=False)
class _Opening:
    """`base`: the cell as the services know it; `real`: the cell behind the protocols."""

    stack: ExitStack
    base: dict[str, Any]
    real: dict[str, Any]
    hides: int | None
    folder: Path
    endpoint: str
    environment: dict[str, str]

    def start(self, name: str, ready: str, *words: str, **environment: str) -> Peer:
        """Start a peer and wait until it prints that it is ready; without `word` do not wait."""
        peer = self.stack.enter_context(Peer(name, list(words), {**self.environment, **environment}, self.folder))
        if ready:
            peer.line(ready)
        return peer

    def with_cameras(self) -> dict[str, Any]:
        """`real` with cameras that see the arm's pose, and the board where somebody holds it."""
        held = [] if self.hides is None else held_by_hand(self.real, self.hides)
        options = {"follow_port": SEEN_PORT, "held": held}
        return merged(self.real, {"hardware": {"options": options}})


def _open_ur(opening: _Opening) -> Plant:
    """The arm behind a Universal Robots controller, its sensor behind a Net F/T box, its cameras on GigE Vision."""
    module = "services.operator.bench.protocols.ati"
    opening.start(
        "ati", "ready", module, "--host", SENSOR, "--http-port", "80", "--feed-port", str(FEED_PORT),
        "--drift-ppm", "40",
    )  # fmt: skip
    real = _written(opening.folder, "plant.yaml", opening.real)
    arm = opening.start(
        "ur", "ready", "services.hardware.peers.ur", "--address", ARM, "--cell", real,
        "--feed", f"{SENSOR}:{FEED_PORT}", "--seen-by", f"127.0.0.1:{SEEN_PORT}",
    )  # fmt: skip
    arm.ask(f"seed {opening.real['hardware']['simulated']['seed']}")
    calibration = _open_cameras(opening)
    told = {
        "driver": "ur",
        "drivers": {"force_torque": "ati", "camera": "genicam"},
        "ur": {"host": ARM},
        "ati": {"host": SENSOR},
        "genicam": {"left": LEFT, "right": RIGHT, "calibration": calibration, "exposure_s": EXPOSURE_S},
        "limits": {"sensor_delay_s": 0.036},
    }
    return Plant(merged(opening.base, {"hardware": merged(told, HERE)}), arm, opening.real)


def _open_cameras(opening: _Opening) -> str:
    """The simulated cell's cameras, and two on GigE Vision that show their pictures; returns the calibration's file."""
    content = merged(opening.with_cameras(), {"cell": {"name": CAMERAS_CELL}})
    file = _written(opening.folder, "cameras.yaml", content)
    opening.start("cameras", "", "services.hardware.peers.following", CROSSPIH_CELL=file)
    with contextlib.closing(Bus(open_zenoh(opening.endpoint, READY_S), CAMERAS_CELL, "operator")) as bus:
        told = bus.latest(CAMERA_CALIBRATION).wait_for(lambda _: True, READY_S)
    if told is None:
        raise NoService("cameras: the simulated cameras did not come up")
    path = opening.folder / "cameras-calibration.json"
    path.write_text(told.model_dump_json(), encoding="utf-8")
    opening.start(
        "genicam", "cameras:", "services.operator.bench.protocols.genicam", "--left", LEFT, "--right", RIGHT,
        "--from-cell", CAMERAS_CELL, "--endpoint", opening.endpoint, "--exposure", str(EXPOSURE_S),
        "--clock-offset", "3.7",
    )  # fmt: skip
    return str(path)


def _open_ros2(opening: _Opening) -> Plant:
    """The arm, its sensor and its cameras behind ROS 2 topics."""
    rate_hz = 250
    told = {
        "driver": "ros2",
        "ros2": {
            "endpoint": opening.endpoint,
            "arm": {"rate_hz": rate_hz, "joint_names": [f"joint_{number}" for number in range(1, 7)]},
            "force_torque": {"rate_hz": rate_hz},
        },
        "limits": {"sensor_delay_s": 0.03, **HERE["limits"]},
    }
    simulated = {"hardware": {**told, "simulated": {"period_s": 1.0 / rate_hz}}}
    file = _written(opening.folder, "plant.yaml", merged(opening.real, simulated))
    module = "services.hardware.peers.ros2"
    arm = opening.start("ros2_control", "peer:", module, "--cell", file)
    opening.start("ros2_cameras", "peer:", module, "--cell", file, "--devices", "camera")
    return Plant(merged(opening.base, {"hardware": told}), arm, opening.real)


def needs_private_network(way: ProtocolWay) -> bool:
    """Whether it needs addresses that the machine may not have."""
    return way is ProtocolWay.UR and sys.platform == "linux"
