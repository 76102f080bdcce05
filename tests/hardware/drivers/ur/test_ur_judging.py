"""What the driver compares on connecting, how it reads the wrist sensor, and its stamps: without a connection."""

from __future__ import annotations

import numpy as np
import pytest

from crosspih_common.arm import NAMED_ARMS, ur5e
from crosspih_common.geometry import Pose, wrench_of_force_at_point
from services.hardware.drivers.ur import checks
from services.hardware.drivers.ur.readings import raw_reading
from services.hardware.drivers.ur.stamps import Stamps
from services.hardware.drivers.ur.states import program_state, why_it_cannot_move
from services.hardware.peers.ur.robot import ROBOT_MODES, SAFETY_MODES
from tests.hardware.drivers.ur.ur_peer import robot

E, CB3 = (5, 12), (3, 15)
HOME = np.asarray(NAMED_ARMS["ur5e"].home_rad)
GRAVITY = np.array([0.0, 0.0, -9.81])


@pytest.mark.parametrize(
    ("arm", "model", "version", "fits"),
    [
        ("ur5e", "UR5", E, True),
        ("ur5e", "UR5e", E, True),
        ("ur5e", "UR10", E, False),
        ("ur5e", "UR5", CB3, False),
        ("ur5", "UR5", CB3, True),
        ("ur10e", "UR16", E, False),
        ("my-calibrated-arm", "UR5", E, True),
    ],
)
def test_the_arm_of_the_file_against_the_robots_type(
    arm: str, model: str, version: tuple[int, int], fits: bool
) -> None:
    said = checks.wrong_model(arm, model, version)
    assert (said is None) == fits
    if said is not None:
        assert "cell.arm" in said and model in said


def test_a_flange_that_is_elsewhere_is_another_arm() -> None:
    model = ur5e()
    tcp = model.pose_base_flange(HOME) @ Pose.from_rotvec([0.0, 0.1, 0.3], [0.0, 0.01, 0.12])
    off = [0.0, 0.01, 0.12, 0.0, 0.1, 0.3]
    flange = checks.flange_by([*tcp.translation_m, *tcp.rotvec_rad()], off)
    assert checks.wrong_flange(model, HOME.tolist(), flange, 0.001) is None
    calibrated = flange @ Pose.from_translation([0.0, 0.002, 0.0])
    assert checks.wrong_flange(model, HOME.tolist(), calibrated, 0.005) is None
    assert "2.00 mm" in checks.flange_note(model, HOME.tolist(), calibrated)
    said = checks.wrong_flange(model, HOME.tolist(), calibrated, 0.001)
    assert said is not None and "2.0 mm" in said and "docs/arms.md" in said
    turned = checks.wrong_flange(model, HOME.tolist(), flange @ Pose.from_rotvec([0.0, 0.0, np.pi], np.zeros(3)), 0.005)
    assert turned is not None


def test_payload_speed_and_control_mode() -> None:
    assert checks.known_payload_kg(None, 9.80665) == pytest.approx(1.0)
    assert checks.known_payload_kg(2.0, 9.8) == 2.0
    assert checks.wrong_payload(0.0, None, 0.2) is None
    assert checks.wrong_payload(0.9, 1.0, 0.2) is None
    assert "1.00 kg hang there" in (checks.wrong_payload(0.0, 1.0, 0.2) or "")
    assert checks.too_slow(1.0) is None and "50 %" in (checks.too_slow(0.5) or "")
    assert checks.not_remote("true", E) is None
    assert checks.not_remote("could not understand", CB3) is None
    assert "Remote Control" in (checks.not_remote("false", E) or "")


@pytest.mark.parametrize("mode", [mode for mode in ROBOT_MODES if mode != 7])
def test_each_robot_mode_in_which_it_cannot_move_has_a_name_and_a_mend(mode: int) -> None:
    said = why_it_cannot_move(mode, 1)
    assert said is not None and said.startswith(f"robot mode {mode}, ") and said.split(": ")[1]


@pytest.mark.parametrize("mode", [*[mode for mode in SAFETY_MODES if mode > 2], 99])
def test_each_safety_mode_goes_before_the_robots(mode: int) -> None:
    said = why_it_cannot_move(3, mode)
    assert said is not None and said.startswith(f"safety mode {mode}, ") and said.split(": ")[1]


def test_normal_and_reduced_may_move() -> None:
    assert why_it_cannot_move(7, 1) is None and why_it_cannot_move(7, 2) is None
    assert program_state(4) == "paused" and program_state(77) == "runtime state 77"


def test_the_compensated_output_gives_the_raw_one_back() -> None:
    made = robot()
    rng = np.random.default_rng(3)
    for _ in range(20):
        made.set_points.restart(HOME + rng.uniform(-0.5, 0.5, 6))
        made.source.advance(made.set_points.joints_rad, np.zeros(6))
        seen: dict[str, object] = {}
        made.on_cycle(lambda outputs, seen=seen: seen.update(outputs, force=outputs["actual_TCP_force"]))  # type: ignore[misc]
        made.cycle()
        package = dict(seen, actual_TCP_force=seen["force"])
        raw = raw_reading("ft_raw_wrench", package, ur5e(), 5, GRAVITY)
        again = raw_reading("actual_TCP_force", package, ur5e(), 5, GRAVITY)
        assert again == pytest.approx(raw, abs=1e-9)
        assert np.linalg.norm(raw[:3]) == pytest.approx(0.974 * 9.81, abs=0.6)


def test_a_cb3_tells_it_about_the_tool_centre_point() -> None:
    model = ur5e()
    turn = model.pose_base_flange(HOME).rotation
    push, tcp = np.array([3.0, -2.0, 10.0]), np.array([0.0, 0.02, 0.15])
    package = {
        "actual_q": HOME.tolist(), "tcp_offset": [*tcp, 0.0, 0.0, 0.0], "payload": 0.0, "payload_cog": [0.0, 0.0, 0.0],
        "actual_TCP_force": [*(turn @ push), 0.0, 0.0, 0.0],  # a force through the tool centre point
    }  # fmt: skip
    expected = wrench_of_force_at_point(push, tcp)
    assert raw_reading("actual_TCP_force", package, model, 3, GRAVITY) == pytest.approx(expected)
    package["actual_TCP_force"] = [*(turn @ push), *(turn @ expected[3:])]  # an e-Series: about the flange
    assert raw_reading("actual_TCP_force", package, model, 5, GRAVITY) == pytest.approx(expected)


def test_stamps_go_on_evenly_whatever_the_network_does() -> None:
    rng = np.random.default_rng(1)
    stamps, told = Stamps(), []
    for cycle in range(3000):
        device_s = 100.0 + 0.002 * cycle
        late_s = 1e-4 + (0.01 if cycle % 97 == 0 else 0.0) + 1e-4 * rng.random()
        stamps.observe(device_s, round((5.0 + 0.002 * cycle + late_s) * 1e9))
        told.append(stamps.to_ns(device_s))
    steps = np.diff(told)
    assert steps.min() >= 0.98 * 2e6 and steps.max() <= 1.02 * 2e6
    assert abs(told[-1] - round((5.0 + 0.002 * 2999) * 1e9)) < 1e6
    # the controller was restarted: its time begins anew, ours goes on
    stamps.observe(0.5, round(30e9))
    assert stamps.to_ns(0.5) > told[-1]
