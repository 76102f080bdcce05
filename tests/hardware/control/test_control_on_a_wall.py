"""The control layer over a driver that was not written for it: docs/examples/spring_wall.py, at rates of its own."""

from __future__ import annotations

import threading
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.messages import AdmittanceMove, Dwell, GuardedMove, MoveLinear, PoseData, SetPayload, StopReason
from docs.examples import spring_wall
from services.hardware.config import HardwareConfig
from services.hardware.hosting import HostedCell, open_cell
from services.hardware.protocols import WrenchSamples

WORKCELL = Workcell()
START = WORKCELL.pose_base_peg(WORKCELL.home_joints_rad)
TIP_Z_M = float(START.apply([0.0, 0.0, WORKCELL.peg.shape().tip_m])[2])
WALL = frozenset({"arm", "force_torque"})
DOWN = (0.0, 0.0, -1.0)
OPTIONS = MappingProxyType({"weight_n": 8.0, "stiffness_n_m": 1e5, "wall_z_m": TIP_Z_M - 0.004})
CAP_N = 60.0


LANDING = MappingProxyType({"moved_mass_kg": 8.0, "contact_stiffness_n_m": 5e6})


def on_the_wall(**limits: float) -> HostedCell:
    config = HardwareConfig.model_validate(
        {"driver": "docs.examples.spring_wall:open_devices", "options": dict(OPTIONS), "limits": {**LANDING, **limits}}
    )
    cell = open_cell(WORKCELL, config, realtime=False, wanted=WALL)
    cell.arm.set_payload(
        SetPayload(bias=(0.0,) * 6, weight_n=8.0, centroid_ft_m=(0.0, 0.0, 0.03), gravity_base=(0.0, 0.0, -1.0))
    )
    return cell


def test_a_driver_is_thin() -> None:
    assert len(Path(spring_wall.__file__).read_text(encoding="utf-8").splitlines()) <= 100


def test_the_wall_is_felt_where_it_is_at_500_hz() -> None:
    cell = on_the_wall()
    outcome = cell.arm.guarded_move(GuardedMove(direction_base=DOWN, speed_m_s=0.005, travel_limit_m=0.02))
    assert outcome.stop_reason is StopReason.CONTACT
    assert outcome.travel_first_contact_m == pytest.approx(0.004, abs=3e-5)
    assert outcome.wrench_observed_raw is not None and outcome.peak_force_n < CAP_N


@pytest.mark.parametrize("period_s", [0.001, 0.002, 0.004, 0.008])
@pytest.mark.parametrize("speed_m_s", [0.005, 0.25])
def test_no_guarded_move_presses_beyond_the_cap_at_any_rate(
    monkeypatch: pytest.MonkeyPatch, period_s: float, speed_m_s: float
) -> None:
    monkeypatch.setattr(spring_wall, "PERIOD_S", period_s)
    cell = on_the_wall()
    outcome = cell.arm.guarded_move(GuardedMove(direction_base=DOWN, speed_m_s=speed_m_s, travel_limit_m=0.02))
    assert outcome.stop_reason in (StopReason.CONTACT, StopReason.FORCE_CAP)
    assert outcome.peak_force_n <= 1.1 * CAP_N
    assert bool(outcome.notes) == (speed_m_s == 0.25)


def test_a_push_yields() -> None:
    cell = on_the_wall()
    pushed = cell.arm.admittance_move(
        AdmittanceMove(direction_base=DOWN, speed_m_s=0.1, travel_m=0.02, axial_force_n=15.0, timeout_s=0.2)
    )
    assert pushed.stop_reason in (StopReason.STALLED, StopReason.TIMED_OUT) and pushed.peak_force_n <= 1.1 * CAP_N


def test_a_line_into_the_wall_backs_off() -> None:
    cell = on_the_wall()
    goal = Pose(START.rotation, START.translation_m + np.array([0.0, 0.0, -0.015]))
    straight = cell.arm.move_linear(MoveLinear(pose_base_peg=PoseData.of(goal), speed_m_s=0.005))
    assert straight.stop_reason is StopReason.FORCE_CAP and straight.peak_force_n <= 1.1 * CAP_N
    rest = cell.arm.dwell(Dwell(duration_s=0.1))
    assert rest.peak_force_n < 6.0


def test_what_leaves_no_room_is_refused_with_what_is_allowed() -> None:
    cell = on_the_wall()
    with pytest.raises(CommandRefused, match="48 N is the most"):
        cell.arm.guarded_move(
            GuardedMove(direction_base=DOWN, speed_m_s=0.01, travel_limit_m=0.02, force_threshold_n=100.0)
        )
    with pytest.raises(CommandRefused, match="axial_force_n"):
        cell.arm.admittance_move(AdmittanceMove(direction_base=DOWN, speed_m_s=0.01, travel_m=0.02, axial_force_n=90.0))
    with pytest.raises(CommandRefused, match="the motion would take"):
        cell.arm.guarded_move(GuardedMove(direction_base=DOWN, speed_m_s=1e-6, travel_limit_m=0.02))


def test_an_absurd_payload_is_refused_and_the_old_one_stays() -> None:
    cell = on_the_wall()
    for bias in ((0.0, 0.0, -55.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 3.0, 0.0)):
        with pytest.raises(CommandRefused) as refusal:
            cell.arm.set_payload(SetPayload(bias=bias, weight_n=8.0, centroid_ft_m=(0.0, 0.0, 0.03), gravity_base=DOWN))
        assert refusal.value.code == "implausible_payload"
    assert cell.arm.dwell(Dwell(duration_s=0.1)).peak_force_n < 0.1


def test_a_stop_is_heard_while_it_backs_off() -> None:
    """The cap is passed, the arm is on its way back: the stop ends that too."""
    cell = on_the_wall()
    stopped: list[int] = []

    def when_pressed(now_ns: int) -> None:
        force = np.linalg.norm(cell.arm.last_contact()[:3])
        if force > 40.0 and not stopped:
            armed.set()
        elif armed.is_set() and force < 30.0 and not stopped:
            stopped.append(now_ns)
            cell.arm.stop()

    armed = threading.Event()
    cell.arm.on_joint_state(lambda state: when_pressed(state.stamp_ns))
    goal = Pose(START.rotation, START.translation_m + np.array([0.0, 0.0, -0.015]))
    outcome = cell.arm.move_linear(MoveLinear(pose_base_peg=PoseData.of(goal), speed_m_s=0.005))
    assert outcome.stop_reason is StopReason.FORCE_CAP
    assert stopped and outcome.stamp_ns - stopped[0] < 100_000_000


def test_a_silent_sensor_and_a_late_loop_end_a_motion() -> None:
    cell = on_the_wall()
    devices = cell._devices
    assert devices.wrench is not None and devices.joints is not None
    read = devices.wrench.read
    silent = WrenchSamples(np.zeros(0, dtype=np.int64), np.zeros((0, 6)))
    devices.wrench.read = lambda: silent  # type: ignore[method-assign]
    outcome = cell.arm.dwell(Dwell(duration_s=1.0))
    assert outcome.stop_reason is StopReason.SENSOR_LOST and outcome.duration_s < 0.2
    devices.wrench.read = read  # type: ignore[method-assign]
    now_ns = devices.joints.now_ns  # type: ignore[attr-defined]
    devices.joints.now_ns = lambda: 3 * now_ns()  # type: ignore[attr-defined]
    outcome = cell.arm.dwell(Dwell(duration_s=1.0))
    assert outcome.stop_reason is StopReason.LATE_CYCLES and "missed" in outcome.detail
