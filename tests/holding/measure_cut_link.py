"""How long an arm goes on when its link is cut: `python -m tests.holding.measure_cut_link link|router`.

In real time: `link` is the holder's, cut without a word while the last joint turns; `router` is killed and, after 2 s,
there again. Prints how the motion ended, and when the arm was at rest, s of the cell's clock after the cut.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from crosspih_common.bus import Bus, open_zenoh
from crosspih_common.errors import CrosspihError
from crosspih_common.holding import hold_arm
from crosspih_common.keys import FOLLOW, JOINT_STATE
from crosspih_common.messages import FollowTrajectory, JointKnot, JointState

PORT = 7792
CELL = "cut"
DEADLINE_S = 60.0
TURN_RAD, TURN_S = 0.6, 6.0
MOVING_RAD_S, AT_REST_RAD_S = 0.15, 1e-3


def quickest_rad_s(state: JointState) -> float:
    """Of all joints."""
    return max(abs(speed) for speed in state.speeds_rad_s)


def turn(endpoint: str) -> None:
    """Hold the arm and turn its last joint."""
    with Bus(open_zenoh(endpoint), CELL, "planning") as bus, hold_arm(bus, "a turn") as lease:
        state = bus.latest(JOINT_STATE).wait_for(lambda _: True, DEADLINE_S)
        assert state is not None
        still, last = (0.0,) * (len(state.joints_rad) - 1), state.joints_rad[-1]
        u = np.linspace(0.0, 1.0, 61)
        way = TURN_RAD * (10 * u**3 - 15 * u**4 + 6 * u**5)
        speeds = TURN_RAD / TURN_S * (30 * u**2 - 60 * u**3 + 30 * u**4)
        accelerations = TURN_RAD / TURN_S**2 * (60 * u - 180 * u**2 + 120 * u**3)
        knots = tuple(
            JointKnot(
                time_s=float(at * TURN_S),
                joints_rad=(*state.joints_rad[:-1], last + float(gone)),
                speeds_rad_s=(*still, float(speed)),
                accelerations_rad_s2=(*still, float(acceleration)),
            )
            for at, gone, speed, acceleration in zip(u, way, speeds, accelerations, strict=True)
        )
        lease.ask(FOLLOW, FollowTrajectory(knots=knots), DEADLINE_S)


def main(cut: str) -> None:
    """One cut."""
    endpoint = f"tcp/127.0.0.1:{PORT}"
    with ExitStack() as stack, tempfile.TemporaryDirectory() as folder:

        def start(module: str, *arguments: str) -> subprocess.Popen[str]:
            process = subprocess.Popen([sys.executable, "-m", module, *arguments], stdout=subprocess.PIPE, text=True)
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        router = start("services.router", "--endpoint", endpoint)
        assert router.stdout is not None and router.stdout.readline()
        cell_file = Path(folder) / "cell.yaml"
        cell_file.write_text(f"cell: {{name: {CELL}}}\n")
        start("services.hardware", "--endpoint", endpoint, "--cell", str(cell_file))
        link = start("tests.holding.stoppable_link", "127.0.0.1", str(PORT))
        assert link.stdout is not None
        through = f"tcp/127.0.0.1:{link.stdout.readline().strip()}"
        bus = stack.enter_context(Bus(open_zenoh(endpoint), CELL, "operator"))
        outcomes, states = bus.latest(FOLLOW.reply_echo), bus.latest(JOINT_STATE, 8192)
        assert states.wait_for(lambda _: True, DEADLINE_S) is not None
        start("tests.holding.measure_cut_link", "turn", through if cut == "link" else endpoint)
        moving = states.wait_for(lambda state: quickest_rad_s(state) > MOVING_RAD_S, DEADLINE_S)
        assert moving is not None
        newest = states.value()
        assert newest is not None
        if cut == "link":
            link.send_signal(signal.SIGSTOP)
        else:
            router.kill()
            time.sleep(2.0)
            again = start("services.router", "--endpoint", endpoint)
            assert again.stdout is not None and again.stdout.readline()
        outcome = outcomes.wait_for(lambda _: True, DEADLINE_S)
        assert outcome is not None
        ended_s = (outcome.stamp_ns - newest.stamp_ns) * 1e-9
        print(f"{cut}: {outcome.stop_reason.value}, the motion ended {ended_s:.3f} s after the cut", end="")
        since = [state for state in states.values() if state.stamp_ns > newest.stamp_ns]
        rest_s = [(one.stamp_ns - newest.stamp_ns) * 1e-9 for one in since if quickest_rad_s(one) < AT_REST_RAD_S]
        print(f", at rest after {rest_s[0]:.3f} s" if cut == "link" and rest_s else "")


if __name__ == "__main__":
    if sys.argv[1] == "turn":
        try:
            turn(sys.argv[2])
        except CrosspihError as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
    else:
        main(sys.argv[1])
