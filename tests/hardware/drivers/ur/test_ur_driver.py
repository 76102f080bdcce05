"""The driver `ur` against a controller on loopback: what it follows, what ends it, and how it comes back."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from crosspih_common.arm import NAMED_ARMS
from crosspih_common.config import load_cell
from crosspih_common.errors import CommandRefused, ConfigError, DeviceLost
from crosspih_common.geometry import Pose
from crosspih_common.messages import MoveLinear
from crosspih_common.messages.base import PoseData
from services.hardware.config import HardwareConfig
from services.hardware.control.arm import ArmController
from services.hardware.drivers.ur.arm import UrArm
from services.hardware.hosting import HostedCell, open_cell
from services.hardware.peers.process import PeerProcess
from services.hardware.peers.ur.robot import Robot
from tests.hardware.drivers.ur.ur_peer import CB3, address, robot, running

CELL = "docs/examples/ur5e-rtde.yaml"
BOTH = frozenset({"arm", "force_torque"})
HOME = np.asarray(NAMED_ARMS["ur5e"].home_rad)
DEADLINE_S = 20.0


def hardware(host: str, limits: dict[str, float] | None = None, **ur: Any) -> HardwareConfig:
    section = load_cell(CELL).sections["hardware"]
    # a test machine has other things to do: late cycles are counted by the exercise, not judged here
    held_to = {**section["limits"], "missed_cycles": 10000, "holder_timeout_s": 5.0, **(limits or {})}
    wanted = {**section, "limits": held_to, "ur": {"host": host, "silence_s": 1.0, **ur}}
    return HardwareConfig.model_validate(wanted)


def opened(config: HardwareConfig, **cell: Any) -> HostedCell:
    workcell = load_cell(CELL).workcell
    return open_cell(workcell.model_copy(update=cell), config, True, BOTH)


def until(true: Callable[[], bool]) -> None:
    given_up_s = time.monotonic() + DEADLINE_S
    while not true():
        assert time.monotonic() < given_up_s, "not in time"
        time.sleep(0.005)


class Running:
    """A peer in a process, and the arm under its controller."""

    def __init__(self) -> None:
        host = address()
        self.peer = PeerProcess("services.hardware.peers.ur", ["--address", host])
        self.hosted = opened(hardware(host))
        self.arm: ArmController = self.hosted.arm
        self.lease = self.arm.holder.take("test", "ur", self.arm.now_ns())
        self._closing = threading.Event()
        self._beats = threading.Thread(target=self._beat, daemon=True)
        self._beats.start()

    def _beat(self) -> None:
        while not self._closing.wait(0.05):
            self.arm.holder.beat(self.lease)

    def close(self) -> None:
        self._closing.set()
        self._beats.join()
        self.hosted.close()
        self.peer.close()

    def state(self, name: str) -> Any:
        return self.peer.tell("state")[name]

    def follows(self) -> bool:
        return bool(self.state("program"))

    def retreat(self, distance_m: float, speed_m_s: float = 0.05) -> Any:
        joints = np.asarray(self.arm.joint_state().joints_rad)
        workcell = load_cell(CELL).workcell
        pose = workcell.arm().pose_base_flange(joints) @ workcell.pose_flange_peg()
        goal = PoseData.of(pose @ Pose.from_translation([0.0, 0.0, -distance_m]))
        return self.arm.move_linear(
            MoveLinear(lease=self.lease, pose_base_peg=goal, speed_m_s=speed_m_s, rotational_speed_rad_s=0.3)
        )

    def lost_in_a_move(self, what: str) -> str:
        """What a move says that this happens in."""
        said: list[str] = []

        def move() -> None:
            with pytest.raises(DeviceLost) as error:
                self.retreat(0.05, 0.02)
            said.append(str(error.value))

        before = np.asarray(self.state("target_q"))
        moving = threading.Thread(target=move)
        moving.start()
        until(lambda: bool(np.max(np.abs(np.asarray(self.state("target_q")) - before)) > 1e-3))
        self.peer.tell(what)
        moving.join(DEADLINE_S)
        assert said, "the move went on"
        return said[0]


@pytest.fixture(scope="module")
def cell() -> Iterator[Running]:
    started = Running()
    try:
        yield started
    finally:
        started.close()


def test_the_robot_goes_where_the_arm_is_told(cell: Running) -> None:
    before = np.asarray(cell.arm.joint_state().joints_rad)
    outcome = cell.retreat(0.02)
    assert outcome.stop_reason.value == "completed"
    told = np.asarray(outcome.joints_rad)
    assert np.max(np.abs(told - before)) > 0.005
    assert cell.follows()
    until(lambda: bool(np.max(np.abs(np.asarray(cell.state("target_q")) - told)) < 1e-3))
    assert np.linalg.norm(outcome.wrench_raw[:3]) == pytest.approx(0.974 * 9.81, abs=0.5)


def test_no_package_is_lost_and_each_brings_a_sample(cell: Running) -> None:
    joints = cell.hosted.arm._joints
    assert isinstance(joints, UrArm)
    with cell.arm.between_motions():
        first = joints.read()
        joints.samples()
        stamps = []
        for _ in range(100):
            last = joints.read()
            joints.write(np.array(last.positions_rad), np.zeros(6))
            stamps += joints.samples().stamps_ns.tolist()
    assert stamps[-1] == last.stamp_ns
    steps = np.diff([first.stamp_ns, *stamps])
    assert len(stamps) >= 100 and np.all(np.abs(steps - 2e6) < 5e4)  # one a cycle, however late they were read


@pytest.mark.parametrize(
    ("what", "undone", "words"),
    [
        ("protective-stop", ("unlock",), "protective stop: clear what it ran into, then unlock it on the pendant"),
        ("gate-open", ("gate-closed",), "safeguard stop: close the gate"),
        ("emergency-stop", ("release", "power 7"), "robot emergency stop: release the button"),
        ("power 3", ("power 7",), "power off: switch the arm on"),
    ],
)
def test_a_stop_of_the_robot_is_named_and_afterwards_the_next_motion_works(
    cell: Running, what: str, undone: tuple[str, ...], words: str
) -> None:
    assert words in cell.lost_in_a_move(what)
    assert not cell.follows()
    with pytest.raises(DeviceLost, match="asked again"):
        cell.retreat(0.01)
    for line in undone:
        cell.peer.tell(line)
    until(cell.follows)
    assert cell.retreat(0.002).stop_reason.value == "completed"


@pytest.mark.parametrize(("what", "words"), [("cut 2.2", "127."), ("silence 2.2", "nothing came from")])
def test_an_arm_that_was_moved_while_it_was_away_stays_where_it_is(cell: Running, what: str, words: str) -> None:
    assert words in cell.lost_in_a_move(what)
    until(lambda: not cell.follows() and not any(cell.state("speeds")))
    cell.peer.tell("nudge 5 0.2")  # somebody turned the wrist by hand
    there = np.asarray(cell.state("target_q"))
    until(cell.follows)
    since = cell.state("cycles")
    until(lambda: cell.state("cycles") > since + 100)
    assert np.asarray(cell.state("target_q")) == pytest.approx(there, abs=2e-3)
    assert cell.arm.joint_state().joints_rad == pytest.approx(there, abs=2e-3)
    assert cell.retreat(0.002).stop_reason.value == "completed"


@pytest.mark.parametrize("turns", [2, 5000])
def test_a_program_that_somebody_else_started_is_named_and_replaced(
    cell: Running, turns: int, capfd: pytest.CaptureFixture[str]
) -> None:
    until(cell.follows)
    joints = cell.hosted.arm._joints
    assert isinstance(joints, UrArm)
    with socket.create_connection((joints._config.host, 30002)) as scripts:
        theirs = (
            f"def theirs_{turns}():\n  turn = 0\n  while turn < {turns}:\n    turn = turn + 1\n    sync()\n  end\nend\n"
        )
        scripts.sendall(theirs.encode())
        until(lambda: f"program theirs_{turns} runs" in cell.peer.tell("log"))
        until(lambda: cell.peer.tell("log")[-1] == "program crosspih_servo runs")
    assert "ended or paused on the pendant, or another was sent" in capfd.readouterr().err
    assert cell.retreat(0.002).stop_reason.value == "completed"


@pytest.mark.parametrize(
    ("made", "ur", "words"),
    [
        (lambda: robot(model="UR10"), {}, r"cell\.arm: name ur5e .* UR10e"),
        (lambda: robot(version=CB3), {}, r"cell\.arm: name ur5e .* UR5 \(PolyScope 3\.15\)"),
        (lambda: robot(version=(5, 8, 0, 0)), {}, r"hardware\.ur\.wrench: .*5\.8.*actual_TCP_force"),
        (lambda: robot(weight_kg=0.0), {}, r"payload of 0\.00 kg, and 0\.97 kg hang there"),
        (lambda: robot(), {"lookahead_s": 0.1}, r"hardware\.limits\.sensor_delay_s: 0\.036 s.*say 0\.105"),
        (lambda: robot(), {"host": "127.0.0.1"}, r"hardware\.ur: no RTDE connection to 127\.0\.0\.1:30004"),
    ],
)
def test_a_cell_that_does_not_fit_is_refused(made: Callable[[], Robot], ur: dict[str, Any], words: str) -> None:
    with running(made()) as host, pytest.raises(ConfigError, match=words):
        opened(hardware(**{"host": host, **ur}))


def test_local_control_another_client_and_a_slow_slider_are_named() -> None:
    made = robot()
    with running(made) as host:
        made.remote_control = False
        with pytest.raises(ConfigError, match="local control and takes no programs"):
            opened(hardware(host))
        made.remote_control, made.speed_slider = True, 0.5
        with pytest.raises(ConfigError, match="speed slider stands at 50 %"):
            opened(hardware(host))
        made.speed_slider = 1.0
        first = opened(hardware(host))
        try:
            with pytest.raises(ConfigError, match=r"input_int_register_24.* is in use"):
                opened(hardware(host))
        finally:
            first.close()


def test_below_5_9_the_other_output_serves() -> None:
    made = robot(version=(5, 8, 0, 0))
    with running(made) as host:
        hosted = opened(hardware(host, wrench="actual_TCP_force"))
        try:
            until(lambda: made.program_running and len(hosted.arm._runner.last_samples) > 5)
            raw = np.mean(hosted.arm._runner.last_samples, axis=0)
            turn = load_cell(CELL).workcell.arm().pose_base_flange(HOME).rotation
            assert raw[:3] == pytest.approx(turn.T @ [0.0, 0.0, -0.974 * 9.81], abs=0.5)
        finally:
            hosted.close()


def test_a_first_set_point_that_is_elsewhere_is_not_sent() -> None:
    made = robot()
    with running(made) as host:
        hosted = opened(hardware(host))
        try:
            joints = hosted.arm._joints
            with hosted.arm.between_motions():
                until(lambda: not _refused(joints.read))
                made.stop_program()  # as on the pendant
                until(lambda: _refused(joints.read))
                until(lambda: not _refused(joints.read))
                with pytest.raises(CommandRefused, match="rad from where a joint stands"):
                    joints.write(np.array(HOME) + 0.05, np.zeros(6))
            assert made.set_points.joints_rad == pytest.approx(HOME, abs=1e-3)
        finally:
            hosted.close()


def _refused(call: Callable[[], object]) -> bool:
    try:
        call()
    except DeviceLost:
        return True
    return False
