"""A cell that is not what its drawing and its calibrations say: the simulator differs, what it tells does not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crosspih_common.config import CameraSection, Workcell
from crosspih_common.geometry import Pose, wrench_of_force_at_point
from crosspih_common.messages import CaptureStereo, Dwell, ResetCell
from crosspih_common.shapes import CrossPeg
from services.hardware.config import HardwareConfig
from services.hardware.drivers.simulated.config import CameraConfig, SimulatedConfig, SimulatedSensorConfig, TruthConfig
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.hardware.drivers.simulated.truth import (
    TrueSensorMounting,
    true_camera,
    true_hole,
    true_peg,
    true_stiffness_nm_rad,
)
from services.hardware.hosting import HostedCell, open_cell

WORKCELL = Workcell()
SMALL = st.floats(-0.01, 0.01)
VECTOR = st.tuples(SMALL, SMALL, SMALL)


def test_by_default_the_cell_is_as_drawn() -> None:
    truth = TruthConfig()
    assert true_peg(WORKCELL, truth) == WORKCELL.peg.shape()
    assert np.array_equal(
        true_hole(WORKCELL, truth).inner_rim_m(), WORKCELL.hole.shape(WORKCELL.peg.shape()).inner_rim_m()
    )
    assert np.array_equal(true_stiffness_nm_rad(WORKCELL, truth), WORKCELL.joint_stiffness_nm_rad)
    camera = StereoRig.of(CameraSection()).pose_base_camera
    assert true_camera(camera, truth) is camera
    wrench = np.arange(6.0)
    assert TrueSensorMounting(truth).felt(wrench) is wrench


@settings(deadline=None)
@given(st.floats(0.95, 1.05))
def test_a_taper_that_is_off_narrows_faster_between_the_same_ends(factor: float) -> None:
    drawn, made = WORKCELL.peg.shape(), true_peg(WORKCELL, TruthConfig(taper_slope_factor=factor))
    assert isinstance(drawn, CrossPeg) and isinstance(made, CrossPeg)
    assert made.taper_start_m == pytest.approx(drawn.taper_start_m, abs=1e-12)
    assert made.tip_m == pytest.approx(drawn.tip_m, abs=1e-12)
    assert made.half_width_m == drawn.half_width_m
    middle_m = (drawn.taper_start_m + drawn.tip_m) / 2.0
    lost = [1.0 - float(peg.scale_at(middle_m)) for peg in (drawn, made)]
    assert lost[1] == pytest.approx(lost[0] * factor, rel=1e-9)


def test_a_hole_that_is_off_is_wider_on_every_side() -> None:
    drawn, made = (true_hole(WORKCELL, TruthConfig(clearance_offset_m=offset)) for offset in (0.0, 5e-5))
    wider = np.abs(made.inner_rim_m()[:, :2]) - np.abs(drawn.inner_rim_m()[:, :2])
    assert np.allclose(wider, 5e-5, atol=1e-12)


@settings(deadline=None)
@given(VECTOR, VECTOR, VECTOR, VECTOR)
def test_a_sensor_off_its_place_feels_forces_about_its_own_origin(
    shift: tuple[float, float, float], turn: tuple[float, float, float], point: tuple[float, float, float],
    force: tuple[float, float, float],
) -> None:  # fmt: skip
    """The same force at the same point, written in the sensor's own frame."""
    felt = TrueSensorMounting(TruthConfig(ft_shift_m=shift, ft_turn_rad=turn)).felt(
        wrench_of_force_at_point(np.array(force), np.array(point))
    )
    into_sensor = Pose.from_rotvec(turn, shift).inverse()
    expected = wrench_of_force_at_point(into_sensor.rotate(np.array(force)), into_sensor.apply(point))
    assert np.allclose(felt, expected, atol=1e-15)


def _cell(truth: TruthConfig) -> HostedCell:
    config = SimulatedConfig(
        truth=truth, force_torque=SimulatedSensorConfig(noise_n=0.0, noise_nm=0.0, bias=(0.0,) * 6),
        camera=CameraConfig(samples=2, noise_grey=0.0),
    )  # fmt: skip
    return open_cell(WORKCELL, HardwareConfig(simulated=config), realtime=False)


def test_the_cell_hides_what_it_is() -> None:
    """The pictures and the readings change, the calibration that goes with them does not."""
    truth = TruthConfig(camera_shift_m=(0.002, 0.0, 0.0), ft_turn_rad=(0.0, 0.0, np.pi / 2))
    seen = []
    for config in (TruthConfig(), truth):
        cell = _cell(config)
        try:
            cell.simulation.reset(ResetCell(seed=3))
            raw = cell.arm.dwell(Dwell(duration_s=0.2)).wrench_raw
            left = cell.camera.capture(CaptureStereo()).left
            seen.append((np.asarray(raw), left, cell.camera.calibration().pose_base_camera, cell.simulation.truth()))
        finally:
            cell.close()
    (level, left, calibration, told), (turned, moved, same_calibration, same_told) = seen
    assert calibration == same_calibration
    assert told.pose_base_hole == same_told.pose_base_hole
    fx, fy, fz = level[:3]
    assert np.allclose(turned[:3], [fy, -fx, fz], atol=0.02)
    assert np.linalg.norm(level[:3]) > 9.0
    # 2 mm to the right at some 0.3 m: everything moves some 2.5 px to the left
    middle = slice(60, -60)
    errors = [
        float(np.mean(np.abs(left[middle, middle].astype(float) - np.roll(moved, step, axis=1)[middle, middle])))
        for step in range(-1, 7)
    ]
    assert int(np.argmin(errors)) - 1 in (2, 3)
