"""`python -m tests.ros2.measure_ros2`: what the bridge adds, and how an arm driver keeps up, on this machine.

The bridge: joint states at 250 Hz from our bus, heard in ROS; the time from one to the other. The arm: zenoh-ros2-sdk
speaks for a ros2_control arm at 100, 250 and 500 Hz, our control layer holds it still; cycles that the loop missed, by
the stamps, and what the arm's side saw: cycles it was itself late for, and the time from a state to the set-point. The
load average of the last minute stands beside each.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.keys import CLOCK, JOINT_STATE
from crosspih_common.messages import CellClock, Dwell, JointState
from crosspih_common.ros2 import RosNode, RosQos, RosSample, RosTypes
from services.hardware.config import HardwareConfig
from services.hardware.hosting import open_cell
from tests.conftest import ServiceProcess, started_router
from tests.ros2.sdk import SdkProcess

STATE = "sensor_msgs/msg/JointState"


def measure_bridge(seconds: float, hz: float = 250.0) -> str:
    """The time from a state on the bus to the same in ROS, ms."""
    router, endpoint = started_router()
    bridge = ServiceProcess("ros2", "--endpoint", endpoint)
    bridge.wait_for_line("in domain 0")
    arrived: dict[int, float] = {}
    with Bus(open_zenoh(endpoint), "cell1", "hardware") as bus, RosNode(endpoint, 0, RosTypes(), "measuring") as node:

        def hear(sample: RosSample) -> None:
            message = node.types.decode(sample.payload, STATE)
            arrived[round(float(message.position[0]) * 1e6)] = sample.arrived_ns * 1e-9

        node.subscribe("/joint_states", STATE, hear, RosQos())
        clock, joints = bus.publisher(CLOCK), bus.publisher(JOINT_STATE)
        sent: list[float] = []
        next_s = time.monotonic()
        for index in range(round(seconds * hz)):
            next_s += 1.0 / hz
            time.sleep(max(0.0, next_s - time.monotonic()))
            stamp_ns = round(index / hz * 1e9)
            if index % 5 == 0:
                clock.publish(CellClock(stamp_ns=stamp_ns, boot_id="a", realtime=True, simulated=False))
            sent.append(time.monotonic())
            joints.publish(
                JointState(stamp_ns=stamp_ns, joints_rad=(index * 1e-6, *(0.0,) * 5), speeds_rad_s=(0.0,) * 6)
            )
        threading.Event().wait(0.5)
    bridge.terminate()
    router.terminate()
    late_ms = np.array([(arrived[index] - at) * 1e3 for index, at in enumerate(sent) if index in arrived])
    p50, p95, p99 = np.percentile(late_ms, [50, 95, 99])
    times = f"p50 {p50:.2f}, p95 {p95:.2f}, p99 {p99:.2f}, most {late_ms.max():.1f} ms"
    return f"{len(late_ms)} of {len(sent)} states; {times}"


def measure_arm(hz: float, seconds: float) -> str:
    """Cycles missed by our loop, and the arm's own word."""
    router, endpoint = started_router()
    with tempfile.TemporaryDirectory() as folder:
        arm = SdkProcess(endpoint, Path(folder), "arm", "--rate-hz", f"{hz:g}")
        arm.said("ready")
        section = {"endpoint": endpoint, "arm": {"rate_hz": hz}}
        config = HardwareConfig.model_validate({"driver": "ros2", "ros2": section, "limits": {"missed_cycles": 10_000}})
        cell = open_cell(Workcell(), config, realtime=True, wanted=frozenset({"arm", "force_torque"}))
        before = cell.arm._runner.missed_cycles
        began_s = time.monotonic()
        try:
            ended = cell.arm.dwell(Dwell(duration_s=seconds)).stop_reason.value
        except CommandRefused as error:
            ended = error.code
        lasted_s = time.monotonic() - began_s
        missed, cycles = cell.arm._runner.missed_cycles - before, round(lasted_s * hz)
        cell.close()
        arm.stop()
        told = arm.said("cycles")
        arm.close()
    router.terminate()
    answer = f"p50 {told['lag_p50_s'] * 1e3:.2f}, p95 {told['lag_p95_s'] * 1e3:.2f} ms"
    return (
        f"{hz:g} Hz, {lasted_s:.1f} s: {missed} of {cycles} cycles missed ({100 * missed / cycles:.2f} %), {ended}; "
        f"the arm: late for {told['late']} of {told['cycles']}, state to set-point {answer}"
    )


def main() -> None:
    """Print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    seconds = parser.parse_args().seconds
    sys.setswitchinterval(0.001)
    print(f"bridge: {measure_bridge(seconds)} (load {os.getloadavg()[0]:.0f})", flush=True)
    for hz in (100.0, 250.0, 500.0):
        print(f"arm: {measure_arm(hz, seconds)} (load {os.getloadavg()[0]:.0f})", flush=True)


if __name__ == "__main__":
    main()
