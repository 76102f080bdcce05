"""Six-pose calibration: Table 1 of the paper as a known answer, recovery, refusals, and the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.wrench import Payload, SensorMounting
from services.force_torque.calibration import (
    CalibrationError,
    PosesDoNotSpan,
    ResidualsTooLarge,
    StaticReading,
    WeightPointsUp,
    calibrate,
    missing_gravity_direction,
)
from services.force_torque.calibration_file import (
    CalibrationFileError,
    calibration_file,
    load_calibration,
    save_calibration,
)

# Table 1, signs restored: rotation rows, then force and moment.
TABLE_1 = [
    ([[0.0207, 0, 0.9998], [0, -1, 0], [0.9998, 0, -0.0207]], [-9.552, 0, 0, 0, -0.308, 0]),
    ([[0.9999, 0, -0.0155], [0, -1, 0], [-0.0155, 0, -0.9999]], [0, -0.001, 9.552, 0, -0.001, 0]),
    ([[0.9999, -0.0148, 0], [0, 0, 1], [-0.0148, -0.9999, 0]], [0.085, 9.553, 0, -0.308, 0.006, 0]),
    (
        [[0.4114, 0.1916, 0.8911], [0.4007, -0.9161, 0.0120], [0.8187, 0.3521, -0.4537]],
        [-7.802, -3.319, 3.955, 0.124, -0.244, 0],
    ),
    (
        [[0.4922, 0.2466, 0.8348], [0.3714, -0.9269, 0.0548], [0.7873, 0.2830, -0.5478]],
        [-7.695, -2.747, 4.947, 0.0989, -0.244, 0],
    ),
    (
        [[-0.1457, -0.1829, 0.9723], [-0.2244, -0.9510, -0.2125], [0.9635, -0.2492, 0.0975]],
        [-8.739, 2.220, -1.387, -0.104, -0.272, 0],
    ),
]
PRINTED_P = [0.0006, 0.0011, 0.0327, -0.0034, 0.0081, -0.0065]  # Eq. 15
PRINTED_F0 = [0.1714, -0.0426, -0.0153, -0.0020, 0.0138, -0.0067]  # Eq. 16
PRINTED_G = 9.558

DOWN = (0.0, 0.0, -1.0)
TOOL = Payload(
    bias=np.array([0.8, -0.5, 1.2, 0.03, -0.02, 0.01]),
    weight_base_n=np.array([0.0, 0.0, -9.55]),
    centroid_sensor_m=np.array([0.001, -0.0005, 0.033]),
)


def table_1() -> list[StaticReading]:
    return [StaticReading(np.array(rotation), np.array(wrench)) for rotation, wrench in TABLE_1]


def readings_at(rotations: Array, tool: Payload = TOOL) -> list[StaticReading]:
    return [StaticReading(rotation, tool.free_air(rotation)) for rotation in rotations]


def spread_rotations() -> Array:
    vectors: list[list[float]] = [
        [0, 0, 0],
        [np.pi, 0, 0],
        [np.pi / 2, 0, 0],
        [-np.pi / 2, 0, 0.4],
        [0, np.pi / 2, 0],
        [0, -np.pi / 2, 1],
    ]
    return Rotation.from_rotvec(vectors).as_matrix()


def test_table_1_gives_the_printed_parameters() -> None:
    found = calibrate(table_1())
    assert found.parameters_eq15 == pytest.approx(PRINTED_P, abs=1.3e-4)
    assert found.payload.bias[:3] == pytest.approx(PRINTED_F0[:3], abs=5e-4)
    assert found.payload.bias[3:] == pytest.approx(PRINTED_F0[3:], abs=2.5e-4)
    assert found.payload.weight_n == pytest.approx(PRINTED_G, abs=1.5e-3)


def test_table_1_figures_that_the_paper_does_not_print() -> None:
    found = calibrate(table_1())
    assert found.payload.weight_base_n == pytest.approx([-0.325, -0.036, -9.553], abs=1e-3)
    assert np.degrees(found.payload.tilt_rad(DOWN)) == pytest.approx(1.96, abs=0.01)
    assert found.force_rms_n == pytest.approx(0.11, abs=0.005)
    assert found.moment_rms_nm == pytest.approx(0.0084, abs=0.0001)
    assert np.abs(found.residuals[:, :3]).max() == pytest.approx(0.24, abs=0.005)
    assert np.abs(found.residuals[:, 3]).max() == pytest.approx(0.027, abs=0.001)
    # The offsets are not significant beside their own scatter: most are within two standard deviations of zero.
    assert np.sum(np.abs(found.payload.bias) < 2.0 * found.bias_sd) == 6


@settings(max_examples=50, deadline=None, derandomize=True)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(1.0, 40.0),
    st.lists(st.floats(-5.0, 5.0), min_size=6, max_size=6),
    st.lists(st.floats(-0.05, 0.05), min_size=3, max_size=3),
    st.booleans(),
)
def test_exact_readings_give_the_parameters_back(
    seed: int, weight: float, bias: list[float], centroid: list[float], gravity_free: bool
) -> None:
    tool = Payload(np.array(bias), np.array([0.0, 0.0, -weight]), np.array(centroid))
    rotations = Rotation.random(8, rng=np.random.default_rng(seed)).as_matrix()
    try:
        found = calibrate(readings_at(rotations, tool), gravity_free=gravity_free)
    except PosesDoNotSpan:
        return
    assert found.payload.bias == pytest.approx(tool.bias, abs=1e-8)
    assert found.payload.weight_base_n == pytest.approx(tool.weight_base_n, abs=1e-8)
    assert found.payload.centroid_sensor_m == pytest.approx(tool.centroid_sensor_m, abs=1e-8)
    assert found.force_rms_n < 1e-9


def test_a_tilted_base_is_found_and_its_neglect_shows() -> None:
    tilted = Payload(
        TOOL.bias, Rotation.from_rotvec([0.03, 0.0, 0.0]).apply(TOOL.weight_base_n), TOOL.centroid_sensor_m
    )
    readings = readings_at(spread_rotations(), tilted)
    assert calibrate(readings).payload.tilt_rad(DOWN) == pytest.approx(0.03, abs=1e-9)
    assert calibrate(readings, gravity_free=False).force_rms_n > 0.05


def test_noise_of_averaged_readings_stays_within_the_standard_deviations_told() -> None:
    rng = np.random.default_rng(5)
    sd = np.array([0.1] * 3 + [0.005] * 3) / np.sqrt(500.0)
    scaled = []
    for _ in range(200):
        readings = [
            StaticReading(r.rotation_base_sensor, r.wrench + rng.normal(0.0, sd))
            for r in readings_at(spread_rotations())
        ]
        found = calibrate(readings)
        scaled.append((found.payload.bias - TOOL.bias) / found.bias_sd)
        assert found.payload.weight_n == pytest.approx(TOOL.weight_n, abs=0.02)
        assert found.payload.centroid_sensor_m == pytest.approx(TOOL.centroid_sensor_m, abs=2e-4)
    # About one, and rather too cautious for the moments, whose residuals also hold the force noise times the centroid.
    assert np.all(np.abs(np.std(scaled, axis=0) - 1.0) < 0.35)


def test_too_few_poses_and_poses_that_do_not_span_are_refused_with_the_pose_to_add() -> None:
    with pytest.raises(PosesDoNotSpan, match="5 poses, want at least 6"):
        calibrate(readings_at(spread_rotations()[:5]))
    about_vertical = Rotation.from_rotvec([[0, 0, angle] for angle in np.linspace(0, 5, 6)]).as_matrix()
    with pytest.raises(PosesDoNotSpan, match=r"weight and force bias .* add a pose in which the sensor's \+z axis"):
        calibrate(readings_at(about_vertical))
    # Gravity at two opposite directions only: weight is known, the centroid along them is not.
    two = Rotation.from_rotvec(
        [[0, 0, 0], [np.pi, 0, 0], [0, 0, 1], [0, np.pi, 0], [0, 0, 2], [2.0, 2.4, 0]]
    ).as_matrix()
    two[5] = Rotation.from_rotvec([0, 0, 3]).as_matrix()
    with pytest.raises(PosesDoNotSpan, match="centroid and moment bias"):
        calibrate(readings_at(two), gravity_free=False)


def test_the_missing_direction_is_the_farthest_from_those_present() -> None:
    # rotation_base_sensor = identity: gravity along the sensor's -z.
    assert missing_gravity_direction(readings_at(np.eye(3)[None])).tolist() == [0.0, 0.0, 1.0]
    up = [np.eye(3), np.diag([1.0, -1.0, -1.0])]
    assert abs(missing_gravity_direction(readings_at(np.array(up)))[2]) == 0.0


def test_a_touch_during_calibration_is_refused_and_its_pose_named() -> None:
    readings = readings_at(spread_rotations())
    touched = readings[3].wrench + np.array([4.0, 0.0, 0.0, 0.0, 0.3, 0.0])
    readings[3] = StaticReading(readings[3].rotation_base_sensor, touched)
    with pytest.raises(ResidualsTooLarge, match="worst is pose 4"):
        calibrate(readings)


def test_malformed_readings_are_refused() -> None:
    with pytest.raises(CalibrationError, match="rotation_base_sensor"):
        StaticReading(np.ones((3, 3)), np.zeros(6))
    with pytest.raises(CalibrationError, match="six finite numbers"):
        StaticReading(np.eye(3), np.array([0.0, np.nan, 0.0, 0.0, 0.0, 0.0]))
    upside_down = Payload(TOOL.bias, -TOOL.weight_base_n, TOOL.centroid_sensor_m)
    with pytest.raises(WeightPointsUp, match="points up"):
        calibrate(readings_at(spread_rotations(), upside_down), gravity_free=False)


def test_the_file_comes_back_as_saved(tmp_path: Path) -> None:
    readings = table_1()
    content = calibration_file(
        calibrate(readings), readings, calibrated_at="2026-03-01T12:00:00+00:00", cell="xb4", joints_rad=[[0.1] * 6] * 6
    )
    path = tmp_path / "made" / "ft.yaml"
    save_calibration(content, path)
    loaded = load_calibration(path)
    assert loaded == content
    assert loaded.payload().bias.tolist() == calibrate(readings).payload.bias.tolist()
    assert [p.name for p in path.parent.iterdir()] == ["ft.yaml"]


def test_bad_files_name_the_field(tmp_path: Path) -> None:
    path = tmp_path / "ft.yaml"
    with pytest.raises(CalibrationFileError, match="calibrate the sensor first"):
        load_calibration(path)
    path.write_text("bias: [1, 2", encoding="utf-8")
    with pytest.raises(CalibrationFileError, match="is not YAML"):
        load_calibration(path)
    readings = table_1()
    content = calibration_file(calibrate(readings), readings, calibrated_at="2026-03-01T12:00:00Z", cell="xb4")
    save_calibration(content, path)
    turned = SensorMounting(Pose.from_rotvec([0.0, 0.0, 0.05], np.zeros(3)))
    with pytest.raises(CalibrationFileError, match="has changed since this calibration"):
        load_calibration(path).payload(turned)
    path.write_text(path.read_text(encoding="utf-8").replace("weight_n:", "weigth_n:"), encoding="utf-8")
    with pytest.raises(CalibrationFileError, match=r"weight_n: Field required.*weigth_n: Extra"):
        load_calibration(path)
    with pytest.raises(CalibrationFileError, match="calibrated_at"):
        calibration_file(calibrate(readings), readings, calibrated_at="yesterday", cell="xb4")
