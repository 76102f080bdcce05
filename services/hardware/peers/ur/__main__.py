"""`python -m services.hardware.peers.ur`: a Universal Robots controller on loopback.

It answers on the ports that a robot answers on, so two of them want two addresses: 127.0.0.2, 127.0.0.3, ... on Linux.
With `--cell FILE` the simulated cell of the file is behind it, its arm moved by the controller's set-points and its
sensor as the wrist's; else plain joints that feel nothing but a weight. It says `ready` on standard output. Lines on
standard input are what happens to a robot; each is answered by one line:

    protective-stop | unlock | emergency-stop | release | gate-open | gate-closed | power MODE | local | remote
    cut SECONDS | silence SECONDS | nudge JOINT RAD | seed N | truth | state | log | quit
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.arm import NAMED_ARMS
from services.hardware.peers.seen import JointsTeller
from services.hardware.peers.ur.ports import ControllerPorts
from services.hardware.peers.ur.robot import Robot
from services.hardware.peers.ur.sources import FeedingJoints, JointSource, OwnJoints, SeenJoints

VERSIONS = {"e": (5, 12, 0, 1101319), "cb3": (3, 15, 0, 106331)}


def main() -> int:
    """Serve until standard input ends."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--address", default="127.0.0.1")
    parser.add_argument("--series", choices=sorted(VERSIONS), default="e", help="e: 500 Hz; cb3: 125 Hz")
    parser.add_argument("--model", default="UR5", help="what `get robot model` answers")
    parser.add_argument("--version", help="of PolyScope, as 5.8.0.0; left out, one of the series")
    parser.add_argument("--cell", type=Path, help="the simulated cell of this file is behind it")
    parser.add_argument("--watch-contact", action="store_true", help="`truth` tells the largest contact force; slower")
    parser.add_argument("--feed", help="HOST:PORT of another sensor's other end, which feels what the wrist's does")
    parser.add_argument("--seen-by", help="HOST:PORT of simulated cameras (services/hardware/peers/following.py)")
    parser.add_argument("--payload", type=float, nargs=4, default=(0.974, 0.0, 0.0, 0.1), help="kg and its centre, m")
    parser.add_argument("--weight-kg", type=float, default=0.974, help="of what hangs on plain joints")
    options = parser.parse_args()
    sys.setswitchinterval(0.0005)  # the cycle must not wait 5 ms for a thread that only formats an answer
    version = VERSIONS[options.series]
    if options.version:
        major, minor, bugfix, build = (int(part) for part in options.version.split("."))
        version = (major, minor, bugfix, build)
    period_s = 0.002 if version[0] >= 5 else 0.008
    source: JointSource
    if options.cell is not None:
        from crosspih_common.config import load_cell  # an engine, and all that it needs
        from services.hardware.peers.ur.simulated_cell import CellJoints

        source = CellJoints(load_cell(options.cell), period_s, options.watch_contact)
    else:
        arm = NAMED_ARMS["ur5e"]
        source = OwnJoints(arm.make(), np.asarray(arm.home_rad), period_s, weight_kg=options.weight_kg)
    if options.feed:
        host, _, port = options.feed.rpartition(":")
        source = FeedingJoints(source, host, int(port))
    if options.seen_by:
        source = SeenJoints(source, JointsTeller(options.seen_by))
    robot = Robot(source, options.model, version, period_s)
    robot.payload_kg, robot.payload_cog_m = options.payload[0], list(options.payload[1:])
    ports = ControllerPorts(robot, options.address)
    gc.collect()
    gc.freeze()  # looking through all that is there would hold the cycle up
    closing = threading.Event()
    loop = threading.Thread(target=robot.run, args=(closing,), name="cycle")
    loop.start()
    print("ready", flush=True)
    try:
        for line in sys.stdin:
            words = line.split()
            if words[:1] == ["quit"]:
                break
            if words:
                print(json.dumps(happen(robot, ports, words)), flush=True)
    except KeyboardInterrupt:
        pass
    finally:
        closing.set()
        loop.join()
        ports.close()
        source.close()
    return 0


def happen(robot: Robot, ports: ControllerPorts, words: list[str]) -> Any:
    """What a line of standard input says."""
    name, *values = words
    if name == "state":
        return {
            "cycles": robot.cycles, "late_cycles": robot.late_cycles, "program": robot.program_running,
            "target_q": robot.set_points.joints_rad.tolist(), "speeds": robot.set_points.speeds_rad_s.tolist(),
        }  # fmt: skip
    if name == "log":
        return robot.log[-50:]
    if name == "truth":
        with robot.lock:
            truth = robot.source.truth()
        return None if truth is None else truth.model_dump(mode="json")
    if name in ("local", "remote"):
        robot.remote_control = name == "remote"
        return "ok"
    acts: dict[str, Any] = {
        "protective-stop": robot.protective_stop,
        "unlock": robot.unlock_protective_stop,
        "emergency-stop": lambda: robot.emergency_stop(True),
        "release": lambda: robot.emergency_stop(False),
        "gate-open": lambda: robot.safeguard_stop(True),
        "gate-closed": lambda: robot.safeguard_stop(False),
        "power": lambda mode: robot.power(int(mode)),
        "cut": lambda seconds: ports.cut(float(seconds)),
        "silence": lambda seconds: ports.silence(float(seconds)),
        "nudge": lambda joint, by: robot.nudge(int(joint), float(by)),
        "seed": lambda seed: robot.restart(int(seed)),
    }
    if name not in acts:
        return f"no such thing as {name}: " + ", ".join(sorted(acts))
    acts[name](*values)
    return "ok"


if __name__ == "__main__":
    sys.exit(main())
