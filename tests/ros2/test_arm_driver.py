"""The ROS 2 arm and sensor under our control layer, against an arm spoken for by another implementation."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused, ConfigError, DeviceLost
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import Dwell, FollowTrajectory, JointKnot, StopReason
from crosspih_common.ros2 import RosNode, RosTypes
from services.hardware.config import DEVICES, HardwareConfig
from services.hardware.hosting import HostedCell, open_cell
from tests.conftest import started_router
from tests.ros2.sdk import SdkProcess

pytest.importorskip("rosbags")

WANTED = frozenset(DEVICES) - {"camera"}
HOME = np.array(Workcell().home_joints_rad)
AWAY = np.array([-1.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # from the plate
BACK_S = 15.0  # the arm is back within 5 s; a process needs some of its own to start
DOMAIN = 5


@pytest.fixture(scope="module")
def sdk_arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, SdkProcess]]:
    """A router, and the arm of most tests in a domain of its own: (endpoint, the SDK's process)."""
    pytest.importorskip("zenoh_ros2_sdk")
    router, endpoint = started_router()
    arm = SdkProcess(
        endpoint, tmp_path_factory.mktemp("definitions"), "arm", "--rate-hz", "250", "--shuffled", domain=DOMAIN
    )
    try:
        arm.said("ready")
        yield endpoint, arm
    finally:
        arm.close()
        router.terminate()


def config_of(endpoint: str, arm: dict[str, object] | None = None, **ros2: object) -> HardwareConfig:
    # the machine that runs the tests may be a busy one, on which both sides stand still now and then
    section = {"endpoint": endpoint, "connect_s": 10.0, "arm": {"lost_after_s": 1.0, **(arm or {})}, **ros2}
    limits = {"missed_cycles": 10_000, "sensor_timeout_s": 1.0}
    return HardwareConfig.model_validate({"driver": "ros2", "ros2": section, "limits": limits})


@contextmanager
def cell_of(config: HardwareConfig) -> Iterator[HostedCell]:
    cell = open_cell(Workcell(), config, realtime=True, wanted=WANTED)
    try:
        yield cell
    finally:
        cell.close()


def to(cell: HostedCell, goal: Array, duration_s: float = 0.6) -> FollowTrajectory:
    start = cell.arm.joint_state().joints_rad
    ends = JointKnot(time_s=0.0, joints_rad=start), JointKnot(time_s=duration_s, joints_rad=tuple(goal.tolist()))
    return FollowTrajectory(knots=ends)


def moved(cell: HostedCell, goal: Array) -> None:
    outcome = cell.arm.follow(to(cell, goal))
    assert outcome.stop_reason is StopReason.COMPLETED, outcome.detail
    assert np.abs(np.array(outcome.joints_rad) - goal).max() < 0.02


def test_the_arm_follows_by_either_controller_and_the_sensor_tells_the_weight(sdk_arm: tuple[str, SdkProcess]) -> None:
    for interface, goal in (("positions", HOME + 0.1 * AWAY), ("trajectory", HOME)):
        with cell_of(config_of(sdk_arm[0], {"interface": interface}, domain_id=DOMAIN)) as cell:
            moved(cell, goal)
            dwelt = cell.arm.dwell(Dwell(duration_s=0.3))
            assert dwelt.stop_reason is StopReason.COMPLETED, dwelt.detail
            # the tool of the other end weighs 8 N, whichever way it hangs
            assert np.linalg.norm(dwelt.wrench_raw[:3]) == pytest.approx(8.0, abs=1e-6)
            assert np.abs(np.array(dwelt.joints_rad) - goal).max() < 1e-6
            assert abs(time.monotonic_ns() - cell.arm.now_ns()) < 2_000_000_000  # the cell's clock is not the wall's


def test_an_arm_that_its_own_safety_stopped_is_not_pulled_along_and_does_not_jump(
    sdk_arm: tuple[str, SdkProcess],
) -> None:
    endpoint, arm = sdk_arm
    with cell_of(config_of(endpoint, domain_id=DOMAIN)) as cell:
        moved(cell, HOME)
        arm.process.send_signal(signal.SIGUSR1)
        assert arm.said("stopped")["stopped"]
        with pytest.raises(DeviceLost, match=r"the arm does not follow: joint_\d is 0\.15\d rad from its set-point"):
            cell.arm.follow(to(cell, HOME + 0.3 * AWAY, 2.0))
        arm.process.send_signal(signal.SIGUSR1)
        assert not arm.said("stopped")["stopped"]
        stood = cell.arm.dwell(Dwell(duration_s=0.3))
        assert np.abs(np.array(stood.joints_rad) - HOME).max() < 1e-3
        moved(cell, HOME + 0.1 * AWAY)


@pytest.mark.parametrize(
    ("arm", "others", "said"),
    [
        ({"joint_states": "/other"}, {}, r"joint_states: nothing came on /other within .* there: .*/joint_states"),
        ({"joint_names": [f"j{n}" for n in range(6)]}, {}, r"joint_names: j0, .* wanted, /joint_states has joint_6"),
        ({"joint_names": ["joint_1", "joint_2"]}, {}, r"joint_names: 2 names, want 6 that differ"),
        ({"rate_hz": 500.0}, {}, r"joint_states.rate_hz: says 500, \d+ come"),
        ({"commands": "/servo"}, {}, r"commands: nobody listens to /servo; .*/forward_position_controller/commands"),
        (
            {"commands": "/joint_trajectory_controller/joint_trajectory"}, {},
            r"takes trajectory_msgs/msg/JointTrajectory of another definition",
        ),
        ({}, {"domain_id": 3}, r"nobody publishes it in domain 3 .* topics there: none"),
        ({}, {"force_torque": {"topic": "/joint_states"}}, r"as sensor_msgs/msg/JointState, want geometry"),
        ({}, {"distro": "humble"}, r"of another definition .* than humble's; set hardware.ros2.distro"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_setting(
    sdk_arm: tuple[str, SdkProcess], arm: dict[str, object], others: dict[str, object], said: str
) -> None:
    config = config_of(sdk_arm[0], arm, **{"connect_s": 1.0, "domain_id": DOMAIN, **others})
    with pytest.raises(ConfigError, match=said):
        open_cell(Workcell(), config, True, WANTED)


def test_two_arms_are_not_followed_by_turns(sdk_arm: tuple[str, SdkProcess]) -> None:
    with RosNode(sdk_arm[0], DOMAIN, RosTypes(), "second_arm") as node:
        node.publisher("/joint_states", "sensor_msgs/msg/JointState")
        with pytest.raises(ConfigError, match=r"2 publishers of /joint_states: joint_state_broadcaster, second_arm"):
            open_cell(Workcell(), config_of(sdk_arm[0], domain_id=DOMAIN), True, WANTED)


def test_an_arm_that_was_away_is_found_again_where_it_stands_and_does_not_move(
    sdk_arm: tuple[str, SdkProcess], tmp_path: Path
) -> None:
    with contextlib.ExitStack() as stack:
        away_and_back(sdk_arm[0], tmp_path, stack)


def away_and_back(endpoint: str, folder: Path, stack: contextlib.ExitStack) -> None:
    def started(*arguments: str) -> SdkProcess:
        process = SdkProcess(endpoint, folder, "arm", *arguments, domain=DOMAIN + 1)
        stack.callback(process.close)
        process.said("ready")
        return process

    arm = started()
    elsewhere = HOME + 0.3 * AWAY
    with cell_of(config_of(endpoint, domain_id=DOMAIN + 1)) as cell:
        moved(cell, HOME + 0.1 * AWAY)
        refused: list[CommandRefused] = []

        def long_motion() -> None:
            try:
                cell.arm.follow(to(cell, HOME + 0.3 * AWAY, 4.0))
            except CommandRefused as error:
                refused.append(error)

        moving = threading.Thread(target=long_motion)
        moving.start()
        wait_until(lambda: cell.arm.joint_state().joints_rad[0] < HOME[0] - 0.11, f"the motion begins; {refused}")
        arm.stop(signal.SIGKILL)
        moving.join(BACK_S)
        assert [error.code for error in refused] == ["device_lost"]
        with pytest.raises(DeviceLost, match="no joint state on /joint_states"):
            cell.arm.dwell(Dwell(duration_s=0.1))
        started("--at", *(f"{value:.6f}" for value in elsewhere))
        # within 5 s it is there again, where it stands, and not where it was to go
        wait_until(lambda: abs(cell.arm.joint_state().joints_rad[0] - elsewhere[0]) < 1e-5, "the arm is found again")
        dwelt = cell.arm.dwell(Dwell(duration_s=0.3))
        assert np.abs(np.array(dwelt.joints_rad) - elsewhere).max() < 1e-5
        moved(cell, elsewhere - 0.1 * AWAY)


def wait_until(condition: Callable[[], bool], what: str) -> None:
    until = time.monotonic() + BACK_S
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < until, f"not within {BACK_S} s: {what}"
        pause.wait(0.01)
