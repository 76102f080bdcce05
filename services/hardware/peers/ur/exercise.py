"""`python -m services.hardware.peers.ur.exercise`: the driver `ur` against the controller on loopback, with figures.

The controller runs in a process of its own, the arm's loop in this one. One JSON object a line on standard output:

    servo    straight ways to and fro for --seconds: cycles, missed cycles (in all, and while the arm moved; the rest
             fell while the next command was judged, the arm at rest), and what the controller was late with
    stop     a protective stop in a guarded move: how long until the motion ended, and with which words
    cut      every connection broken for --away seconds in a move, then the cable out for as long: how long until it is
             named, until the arm answers again, and how far it moved by itself meanwhile
    press    guarded moves onto the plate of the simulated cell: the largest force that the engine's contacts had
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import json
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.config import load_cell
from crosspih_common.errors import DeviceLost
from crosspih_common.geometry import Pose
from crosspih_common.messages import GuardedMove, MoveLinear, SetPayload
from crosspih_common.messages.base import PoseData, floats
from services.hardware.config import HardwareConfig
from services.hardware.control.arm import ArmController
from services.hardware.hosting import HostedCell, open_cell
from services.hardware.peers.process import PeerProcess

CELL = Path("docs/examples/ur5e-rtde.yaml")
LONG_S = 30.0
BESIDE_M = (0.036, 0.034)  # of the hole's middle, onto the plate's face: as `crosspih bench caps` presses
BEFORE_M = 0.006
CLEAR_M = 0.06


class Exercised:
    """The peer, and the arm under its controller with a holder that beats."""

    def __init__(self, options: argparse.Namespace, behind: bool) -> None:
        cell = load_cell(options.cell)
        more = ["--cell", str(options.cell), "--watch-contact"] if behind else []
        self.peer = PeerProcess("services.hardware.peers.ur", ["--address", options.address, *more], sys.stderr)
        self._closing = threading.Event()
        config = cell.section("hardware", HardwareConfig)
        assert config.ur is not None
        config = config.model_copy(update={"ur": config.ur.model_copy(update={"host": options.address})})
        self.workcell, self.simulated = cell.workcell, config.simulated
        self.hosted: HostedCell = open_cell(cell.workcell, config, True, frozenset({"arm", "force_torque"}))
        self.arm: ArmController = self.hosted.arm
        self.lease = self.arm.holder.take("exercise", "ur", self.arm.now_ns())
        self._beats = threading.Thread(target=self._beat, daemon=True)
        self._beats.start()
        gc.collect()
        gc.freeze()  # as the hardware service does
        wait_until(lambda: bool(self.peer.tell("state")["program"]))

    def _beat(self) -> None:
        while not self._closing.wait(self.arm.holder.beat_s):
            self.arm.holder.beat(self.lease)

    def close(self) -> None:
        """End all of it."""
        self._closing.set()
        self._beats.join()
        self.hosted.close()
        self.peer.close()

    def pose_base_peg(self) -> Pose:
        """By the encoders."""
        joints = np.asarray(self.arm.joint_state().joints_rad)
        return self.workcell.arm().pose_base_flange(joints) @ self.workcell.pose_flange_peg()

    def line_to(self, pose: Pose, speed_m_s: float = 0.05) -> Any:
        """A straight way."""
        return self.arm.move_linear(
            MoveLinear(
                lease=self.lease, pose_base_peg=PoseData.of(pose), speed_m_s=speed_m_s, rotational_speed_rad_s=0.3
            )
        )

    def know_payload(self) -> None:
        """What a calibration would find: the peer's sensor has no bias but the simulated cell's."""
        payload, mounting = self.simulated.force_torque, self.workcell.sensor_mounting()
        force = payload.payload_kg * np.asarray(self.workcell.gravity_base_m_s2)
        centre = mounting.pose_peg_sensor.inverse().apply(np.asarray(payload.payload_centroid_m))
        self.arm.set_payload(
            SetPayload(
                lease=self.lease, weight_n=float(np.linalg.norm(force)), centroid_ft_m=floats(centre),
                bias=payload.bias, gravity_base=floats(force / np.linalg.norm(force)),
            )
        )  # fmt: skip

    def target_rad(self) -> np.ndarray[Any, Any]:
        """Where the robot's own set-points are."""
        return np.asarray(self.peer.tell("state")["target_q"])


def wait_until(true: Callable[[], bool], within_s: float = LONG_S) -> float:
    """How long it took, s. Raises TimeoutError."""
    began_s = time.monotonic()
    while not true():
        if time.monotonic() - began_s > within_s:
            raise TimeoutError(f"not within {within_s:g} s")
        time.sleep(0.002)
    return time.monotonic() - began_s


def tell(what: str, **figures: Any) -> None:
    """One line of figures."""
    print(json.dumps({"what": what, **figures}), flush=True)


def servo(it: Exercised, options: argparse.Namespace) -> None:
    """To and fro by 30 mm."""
    runner = it.arm._runner
    start, ends = it.pose_base_peg(), []
    before, missed, peer = runner.now_ns, runner.missed_cycles, it.peer.tell("state")
    until_s = time.monotonic() + options.seconds
    moves = in_motion = 0
    while time.monotonic() < until_s:
        off = np.array([0.0, 0.0, -0.03 if moves % 2 == 0 else 0.0])
        ends.append(it.line_to(start @ Pose.from_translation(off)).stop_reason.value)
        in_motion += runner.missed_cycles - it.arm._execution._missed_before
        moves += 1
    after = it.peer.tell("state")
    tell(
        "servo", seconds=round((runner.now_ns - before) * 1e-9, 3), moves=moves, ends=sorted(set(ends)),
        cycles=after["cycles"] - peer["cycles"], missed=runner.missed_cycles - missed,
        missed_in_motion=in_motion,
        controller_late=after["late_cycles"] - peer["late_cycles"],
    )  # fmt: skip


@contextlib.contextmanager
def moving(it: Exercised, move: Callable[[], Any]) -> Iterator[dict[str, Any]]:
    """A motion in a thread of its own, well under way; how it ended and when stands in what is given."""
    found: dict[str, Any] = {}

    def run() -> None:
        try:
            outcome = move()
            found["ended"] = f"{outcome.stop_reason.value} {outcome.detail}".strip()
        except DeviceLost as error:
            found["ended"] = str(error)
        found["at_s"] = time.monotonic()

    before = it.target_rad()
    thread = threading.Thread(target=run)
    thread.start()
    wait_until(lambda: bool(np.max(np.abs(it.target_rad() - before)) > 2e-3))
    yield found
    thread.join(LONG_S)


def guarded(it: Exercised, travel_m: float, speed_m_s: float, threshold_n: float = 5.0) -> Any:
    """Straight on along the peg's axis."""
    return it.arm.guarded_move(
        GuardedMove(
            lease=it.lease, direction_base=floats(it.pose_base_peg().rotation[:, 2]), travel_limit_m=travel_m,
            speed_m_s=speed_m_s, force_threshold_n=threshold_n,
        )
    )  # fmt: skip


def protective_stop(it: Exercised, options: argparse.Namespace) -> None:
    """In a guarded move in free air; unlocked by somebody, the next one works."""
    it.know_payload()
    with moving(it, lambda: guarded(it, 0.03, 0.005)) as found:
        it.peer.tell("protective-stop")
        stopped_s = time.monotonic()
    tell("protective stop", named_after_s=round(found["at_s"] - stopped_s, 4), ended=found["ended"])
    it.peer.tell("unlock")
    back_s = wait_until(lambda: bool(it.peer.tell("state")["program"]))
    outcome = it.line_to(it.pose_base_peg() @ Pose.from_translation([0.0, 0.0, -0.005]))
    tell("unlocked", follows_again_after_s=round(back_s, 3), next_motion=outcome.stop_reason.value)


def cut(it: Exercised, options: argparse.Namespace) -> None:
    """Connections broken, then silence; in between nobody commands anything."""
    for name in ("cut", "silence"):
        with moving(it, lambda: it.line_to(it.pose_base_peg() @ Pose.from_translation([0.0, 0.0, -0.05]), 0.01)) as f:
            it.peer.tell(f"{name} {options.away}")
            gone_s = time.monotonic()
        wait_until(lambda: not any(it.peer.tell("state")["speeds"]))
        at_rest = it.target_rad()
        wait_until(lambda: bool(it.peer.tell("state")["program"]) and _answers(it))
        back_s = time.monotonic() - gone_s
        moved_rad = float(np.max(np.abs(it.target_rad() - at_rest)))
        outcome = it.line_to(it.pose_base_peg() @ Pose.from_translation([0.0, 0.0, 0.005]))
        tell(
            name, away_s=options.away, named_after_s=round(f["at_s"] - gone_s, 3), ended=f["ended"],
            back_after_s=round(back_s, 3), after_the_network_s=round(back_s - options.away, 3),
            moved_by_itself_rad=round(moved_rad, 6), next_motion=outcome.stop_reason.value,
        )  # fmt: skip


def _answers(it: Exercised) -> bool:
    before = it.arm.now_ns()
    time.sleep(0.02)
    return it.arm.now_ns() > before


def press(it: Exercised, options: argparse.Namespace) -> None:
    """Beside the hole: slowly, as fast as it may, and with a high threshold."""
    it.know_payload()
    hole = it.peer.tell("truth")["pose_base_hole"]
    tip_m = it.workcell.peg.shape().tip_m
    before = PoseData.model_validate(hole).pose() @ Pose.from_translation([*BESIDE_M, -tip_m - BEFORE_M])
    for speed_m_s, threshold_n in ((0.002, 3.0), (0.25, 3.0), (0.25, 30.0)):
        it.line_to(before @ Pose.from_translation([0.0, 0.0, -CLEAR_M]))
        it.line_to(before)
        outcome = guarded(it, 0.02, speed_m_s, threshold_n)
        tell(
            "press", asked_m_s=speed_m_s, threshold_n=threshold_n, notes=list(outcome.notes),
            ended=outcome.stop_reason.value, felt_n=round(outcome.peak_force_n, 2),
            contact_n=round(it.peer.tell("truth")["peak_contact_n"], 2), cap_n=it.hosted.arm._config.force_cap_n,
        )  # fmt: skip


WHAT = {"servo": servo, "stop": protective_stop, "cut": cut, "press": press}


def main() -> int:
    """Do what is asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=sorted(WHAT), nargs="+")
    parser.add_argument("--cell", type=Path, default=CELL)
    parser.add_argument("--address", default="127.0.0.2", help="of the controller that is started")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--away", type=float, default=3.0)
    options = parser.parse_args()
    sys.setswitchinterval(0.001)
    for what in options.what:
        it = Exercised(options, behind=what == "press")
        try:
            WHAT[what](it, options)
        finally:
            it.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
