"""Self-calibration: synthetic pasts of a cell with known errors, and what cannot be known from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from crosspih_common.config import Workcell, load_cell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import adjoint_wrench
from crosspih_common.messages import IdentifyPayload, PoseData, RawReading, floats
from crosspih_common.recording.reader import RecordingError
from crosspih_common.wrench import Payload
from services.inference.cell_refinement.assemblies import (
    AssemblyData,
    NothingToRefine,
    RecordedAssemblies,
    SeenHole,
    Weighing,
    read_past,
    weighing_of,
)
from services.inference.cell_refinement.parameters import CLEARANCE, NAMES, PRIOR_SD, TAPER, judged, refined_peg, shapes
from services.inference.cell_refinement.pressed import displacement
from services.inference.cell_refinement.result import refine
from services.inference.cell_refinement.touched import TouchModel, TouchState
from services.inference.cell_refinement.weighing import sensor_turn
from services.inference.estimator import BoreWalls, EstimatorSettings, TouchObservation
from services.inference.mechanics import PairTables
from tests.inference.synthetic_touch import COMPLIANCE, synthetic_touch

CELL = load_cell("deploy/cells/default.yaml")
WORKCELL = CELL.workcell
CAMERA = Pose.from_rotvec([0.1, 2.0, 0.3], [0.1, -0.3, 0.25])
OFF = Pose.from_rotvec([0.006, -0.005, 0.004], [0.0015, -0.0012, 0.0006])
CLEARANCE_OFF_M = 5e-5
VISION_SD = np.array([5e-5, 5e-5, 1.5e-4, 3e-3, 3e-3, 5e-4])
READING_SD = np.repeat([0.02, 0.001], 3)


def pressed(hole: Pose, rng: np.random.Generator) -> tuple[TouchObservation, ...]:
    """Four presses of a crooked peg, moved along until the first wall is met; the arm is stiff."""
    peg, bore = shapes(WORKCELL, 0.0, CLEARANCE_OFF_M)
    walls = BoreWalls.of(peg, bore)
    depth = peg.taper_start_m - bore.chamfer_m - 0.02
    points = np.concatenate([walls.points(bore.chamfer_m), walls.points(bore.chamfer_m + 0.02)])
    tilt = rng.choice([-1.0, 1.0], size=3) * [5e-3, 5e-3, 2e-4]
    start = Pose.from_rotvec(tilt, [0.0, 0.0, -depth])
    # on the axis in the middle of what entered
    middle = displacement(start)[:2] + np.array([tilt[1], -tilt[0]]) * (bore.chamfer_m + 0.01)
    start = Pose(start.rotation, start.translation_m - [*middle, 0.0])
    made = []
    for direction in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]):
        gap = np.tile(walls.clearances_m, 2) + points @ displacement(start)
        closing = -points[:, :2] @ direction[:2]
        travel = np.min(np.where(closing > 0.5, gap / np.maximum(closing, 0.5), np.inf))
        at = Pose(start.rotation, start.translation_m + travel * np.array(direction))
        force = -6.0 * start.rotation.T @ direction
        wrench = np.concatenate([force, np.zeros(3)]) + rng.normal(size=6) * READING_SD
        seen = hole @ at @ Pose.from_translation(rng.normal(size=3) * 3e-6)
        made.append(TouchObservation(seen, wrench, READING_SD, np.zeros((6, 6)), hole.rotate(direction)))
    return tuple(made)


def past(count: int, rng: np.random.Generator) -> RecordedAssemblies:
    assemblies = []
    for index in range(count):
        move = rng.uniform(-1.0, 1.0, size=6) * WORKCELL.hole_prior.half_ranges()
        hole = WORKCELL.hole_prior.pose_base_hole() @ Pose.from_rotvec(move[3:], move[:3])
        error = rng.normal(size=6) * VISION_SD
        seen = (CAMERA @ OFF).inverse() @ hole @ Pose.from_rotvec(error[3:], error[:3])
        start = hole @ Pose.from_rotvec(rng.normal(size=3) * 2e-3, [*rng.normal(size=2) * 4e-5, 1e-3])
        assemblies.append(
            AssemblyData(str(index), start, (), pressed(hole, rng), SeenHole(seen, np.diag(VISION_SD**2), CAMERA))
        )
    return RecordedAssemblies(tuple(assemblies), (), ())


def test_the_clearance_and_the_camera_are_found_from_presses_and_vision() -> None:
    found = refine(CELL, past(12, np.random.default_rng(3)))
    by_name = {one.name: one for one in found.parameters}
    clearance = by_name["clearance"]
    assert clearance.taken
    assert clearance.found == pytest.approx(CLEARANCE_OFF_M, abs=min(4.0 * clearance.sd, 2.5e-5))
    truth = np.concatenate([OFF.translation_m, OFF.rotvec_rad()])
    for name, value in zip(NAMES[8:], truth, strict=True):
        assert abs(by_name[name].found - value) < 4.0 * by_name[name].sd, name
    # turn and shift are hard to tell apart, but what is seen at the hole is right
    hole = CAMERA.inverse() @ WORKCELL.hole_prior.pose_base_hole()
    values = np.array([by_name[name].value for name in NAMES[8:]])
    used = Pose.from_rotvec(values[3:], values[:3])
    assert (used @ hole).distance_to_m(OFF @ hole) < 0.4e-3 < 2e-3 < hole.distance_to_m(OFF @ hole)
    assert found.joint.vision_rms[1] < 0.5 * found.joint.vision_rms[0]
    # without a touch nobody knows the taper nor the sensor's place
    assert not any(by_name[name].taken for name in ("taper", "ft_x", "ft_y", "ft_z"))
    assert any("taper" in note and "touches" in note for note in found.notes)
    settings = found.settings(CELL)
    assert set(settings) == {"cell", "vision"}
    assert set(settings["cell"]) == {"hole"}  # type: ignore[call-overload]


def touched(taper: float, clearance_m: float, count: int) -> TouchState:
    """Touches of the hole's edges by a peg of that taper, each turned and set off in its own way; without noise."""
    rng = np.random.default_rng(4)
    peg, hole = shapes(WORKCELL, taper, clearance_m)
    tables, axis = PairTables.of(peg, hole), np.array([0.0, 0.0, 1.0])
    found = []
    for _ in range(count):
        turn, off = rng.uniform(-0.06, 0.06, size=3), rng.uniform(-1.5e-3, 1.5e-3, size=2)
        start = Pose.from_rotvec(turn, [*off, -peg.tip_m - 3e-3])
        touch = synthetic_touch(tables, Pose.identity(), start, axis, 0.1, rng, force_n=6.0, noise=0.0)
        twist = touch.compliance_peg @ touch.wrench_peg
        found.append((touch.pose_base_peg @ Pose.from_rotvec(twist[3:], twist[:3]), touch.wrench_peg))
    return TouchState(
        np.array([pose.rotation for pose, _ in found]), np.array([pose.translation_m for pose, _ in found]),
        np.array([wrench for _, wrench in found]), np.tile(axis, (count, 1)),
    )  # fmt: skip


def test_touches_tell_taper_and_clearance() -> None:
    """Judged with the drawing's shape, the residuals have their least at the true one."""
    state, count = touched(0.012, CLEARANCE_OFF_M, 24), 24
    model = TouchModel.of(
        WORKCELL, state, np.zeros(len(NAMES)), 0.1, np.tile(READING_SD, (count, 1)), np.tile(COMPLIANCE, (count, 1, 1)),
        EstimatorSettings(friction_mean=0.1), 0.0,
    )  # fmt: skip

    def residual(x: Array) -> Array:
        parameters = np.zeros(len(NAMES))
        parameters[[TAPER, CLEARANCE]] = x * [0.01, 1e-5]
        return model.residual(state, parameters, 0.1).ravel()

    best = least_squares(residual, np.zeros(2))
    assert best.x * [0.01, 1e-5] == pytest.approx([0.012, CLEARANCE_OFF_M], rel=0.1)
    assert best.cost < 0.25 * 0.5 * np.sum(residual(np.zeros(2)) ** 2)


def test_the_turn_of_the_sensor_is_weighed() -> None:
    rng = np.random.default_rng(0)
    turn = np.array([0.004, -0.003, 0.002])
    rotations = Rotation.random(8, random_state=1).as_matrix()
    weight, bias = np.array([0.05, -0.03, -9.5]), np.array([0.2, -0.1, 0.05])
    force = np.einsum("nji,j->ni", rotations, weight) @ Rotation.from_rotvec(turn).as_matrix() + bias
    sd = np.full((8, 3), 0.006)
    found = sensor_turn([Weighing(rotations, force + rng.normal(size=(8, 3)) * sd, sd)], PRIOR_SD[5:8])
    assert found is not None
    assert found[0] == pytest.approx(turn, abs=1.5e-3)
    assert np.all(np.sqrt(np.diag(found[1])) < 1.5e-3)
    assert sensor_turn([Weighing(rotations[:3], force[:3], sd[:3])], PRIOR_SD[5:8]) is None


def test_the_turn_is_weighed_for_a_sensor_with_axes_sign_and_units_of_its_own() -> None:
    drawn = {
        "reports": "reaction",
        "axes": ["-y", "x", "z"],
        "force_unit": "mN",
        "pose_flange_sensor": {"position_m": [0.0, 0.001, 0.0363], "rotvec_rad": [0.0, 0.0, 0.5]},
    }
    turn = np.array([0.004, -0.006, 0.008])
    workcell = Workcell.model_validate({"force_torque": drawn})
    real = Workcell.model_validate({"force_torque": {**drawn, "correction": {"turn_rad": turn.tolist()}}})
    payload = Payload(
        np.array([1.0, -2.0, 0.5, 0.1, 0.0, 0.0]), np.array([0.0, 0.0, -9.5]), np.zeros(3), real.sensor_mounting()
    )
    readings = tuple(
        RawReading(
            pose_base_peg=PoseData.of(Pose(rotation, np.zeros(3))),
            wrench_raw=floats(payload.mounting.raw(payload.load(rotation))),
            wrench_sd=(5.0,) * 6,
        )
        for rotation in Rotation.random(8, rng=np.random.default_rng(2)).as_matrix()
    )
    weighing = weighing_of(IdentifyPayload(readings=readings), workcell)
    assert weighing.sd_n == pytest.approx(np.full((8, 3), 0.005))
    found = sensor_turn([weighing], PRIOR_SD[5:8])
    assert found is not None
    assert found[0] == pytest.approx(turn, abs=3e-4)  # the tolerance pulls it a little towards none


def test_a_wrench_that_is_moved_by_the_sensor_is_moved_back() -> None:
    wrench = np.array([1.0, -2.0, 6.0, 0.1, -0.2, 0.05])
    mounting = Pose.from_rotvec([0.01, -0.02, 0.03], [2e-4, 1e-4, -3e-4])
    turned, shift = mounting.rotation, mounting.translation_m
    felt = np.concatenate([wrench[:3] @ turned, (wrench[3:] - np.cross(shift, wrench[:3])) @ turned])
    assert adjoint_wrench(mounting) @ felt == pytest.approx(wrench)


def test_what_is_not_fixed_stays_and_the_others_are_conditioned_on_that() -> None:
    covariance: Array = np.array([[1.0, 0.3], [0.3, 0.1]])
    kept, taken = judged(("a", "b"), np.zeros(2), np.array([0.5, 0.4]), covariance, np.array([1.0, 1.0]))
    assert not kept.taken and kept.value == 0.0
    assert taken.taken and taken.value == pytest.approx(0.4 - 0.3 * 0.5)
    assert taken.sd == pytest.approx(np.sqrt(0.1))


@pytest.mark.parametrize("outline", ["cross", "hexagon"])
def test_a_steeper_taper_keeps_its_ends(outline: str) -> None:
    workcell = Workcell.model_validate({"peg": {"outline": outline}})
    before = workcell.peg.shape()
    peg, _ = shapes(workcell, 0.01, 0.0)
    assert peg.taper_start_m == pytest.approx(before.taper_start_m)
    assert peg.tip_m == pytest.approx(before.tip_m)
    lost, lost_before = (1.0 - float(one.scale_at(one.tip_m)) for one in (peg, before))
    assert lost == pytest.approx(1.01 * lost_before)
    assert refined_peg(workcell.peg, 0.01)
    assert NAMES[CLEARANCE] == "clearance"


def test_what_is_no_recording_is_said_to_be_none(tmp_path: Path) -> None:
    path = tmp_path / "not.mcap"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(RecordingError, match="no MCAP file"):
        read_past(CELL, [path], lambda doing, done, total: None)


def test_nothing_to_refine_is_said() -> None:
    with pytest.raises(NothingToRefine, match="no assembly that went in"):
        read_past(CELL, [], lambda doing, done, total: None)
