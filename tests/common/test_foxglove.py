"""What viewers are told: held to the protobuf library, to the arm's own kinematics, to OpenCV and to solid geometry."""

from __future__ import annotations

from collections import defaultdict
from importlib import import_module
from typing import Any

import cv2
import numpy as np
import pytest
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from crosspih_common.arm.description import UrdfChain
from crosspih_common.config import Workcell
from crosspih_common.foxglove import HEARD, TRUTH_HEARD, FoxgloveTopics, ViewerTopic, arm_urdf, viewer_topics
from crosspih_common.foxglove.cameras import pixels_of
from crosspih_common.foxglove.meshes import TriangleMesh, peg_mesh, plate_mesh
from crosspih_common.foxglove.primitives import along
from crosspih_common.foxglove.scenes import CHI2_95_OF_3, FAR_M, MAGNIFIED, line_of_action
from crosspih_common.foxglove.schemas import TRUTH_PREFIX
from crosspih_common.foxglove.wrench_sample import WRENCH_SAMPLE, wrench_encoder
from crosspih_common.geometry import Pose
from crosspih_common.keys import CONTACT_WRENCH, EVENTS, JOINT_STATE, LOCATE, TOUCH, TRUTH, WRENCH_RAW
from crosspih_common.messages import (
    CameraModel,
    ContactState,
    ContactWrench,
    DistortionModel,
    Event,
    HoleEstimate,
    JointState,
    LocateMethod,
    PoseData,
    RawWrenchBatch,
    Severity,
    SimulationTruth,
    Touch,
    TrueContact,
)

ARMS = ("xb4", "ur5e", "panda")
Told = dict[str, list[tuple[int, bytes]]]


def message_of(topic: ViewerTopic) -> Any:
    """The message class that a reader makes of a channel's own schema."""
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(topic.channel_schema()[3]).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(topic.schema))


BY_NAME = {topic.name: message_of(topic) for topic in viewer_topics()}


def told_by(workcell: Workcell, *said: tuple[Any, Any]) -> Told:
    told: Told = defaultdict(list)
    topics = FoxgloveTopics(workcell, lambda topic, stamp_ns, data: told[topic.name].append((stamp_ns, data)))
    for topic, message in said:
        topics.take(topic, message)
    return told


def read(told: Told, name: str, index: int = -1) -> Any:
    _, data = told[f"/foxglove/{name}"][index]
    return BY_NAME[f"/foxglove/{name}"].FromString(data)


def pose_of(transform: Any) -> Pose:
    turn, place = transform.rotation, transform.translation
    return Pose.from_quaternion([turn.x, turn.y, turn.z, turn.w], [place.x, place.y, place.z])


def cell(arm: str = "xb4", **changed: Any) -> Workcell:
    return Workcell.model_validate({"arm": {"name": arm}, **changed})


def joints(workcell: Workcell, stamp_ns: int = 1_500_000_000) -> tuple[Any, JointState]:
    angles = workcell.home_joints_rad
    return JOINT_STATE, JointState(stamp_ns=stamp_ns, joints_rad=angles, speeds_rad_s=(0.1,) * len(angles))


@pytest.mark.parametrize("arm", ARMS)
@settings(max_examples=8, deadline=None)
@given(data=st.data())
def test_the_frames_lead_to_where_the_arms_own_kinematics_have_the_peg(arm: str, data: st.DataObject) -> None:
    workcell = cell(arm)
    count = workcell.arm().joints
    angles = tuple(data.draw(st.lists(st.floats(-3.1, 3.1), min_size=count, max_size=count)))
    state = JointState(stamp_ns=3_000_000_007, joints_rad=angles, speeds_rad_s=angles)
    told = told_by(workcell, (JOINT_STATE, state))
    frames = {transform.child_frame_id: transform for transform in read(told, "transforms").transforms}
    assert {frame.timestamp.ToNanoseconds() for frame in frames.values()} == {3_000_000_007}
    expected = workcell.pose_base_peg(angles)
    pose, frame = Pose.identity(), "peg"
    while frame != "base":
        pose, frame = pose_of(frames[frame]) @ pose, frames[frame].parent_frame_id
    assert pose.distance_to_m(expected) < 1e-12 and pose.angle_to_rad(expected) < 1e-7
    posed = read(told, "pose/peg")
    assert posed.frame_id == "base"
    at = posed.pose.position
    assert np.allclose([at.x, at.y, at.z], expected.translation_m, atol=1e-12)
    # the URDF has the same links: a viewer that shows it moves it by these frames
    chain = UrdfChain.of(arm_urdf(workcell))
    for joint, in_parent in zip(chain.joints, chain.poses(angles), strict=True):
        told_pose = pose_of(frames[joint.child])
        assert frames[joint.child].parent_frame_id == joint.parent
        assert told_pose.distance_to_m(in_parent) < 1e-9 and told_pose.angle_to_rad(in_parent) < 1e-7


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6), st.integers(0, 2**62), st.sampled_from(["peg", "f" * 200])
)
def test_the_library_reads_a_wrench_as_it_was_written(wrench: list[float], stamp_ns: int, frame: str) -> None:
    sample = BY_NAME["/foxglove/wrench/raw"].FromString(wrench_encoder(frame)(stamp_ns, wrench))
    assert sample.DESCRIPTOR.full_name == WRENCH_SAMPLE
    assert sample.timestamp.ToNanoseconds() == stamp_ns and sample.frame_id == frame
    force, moment = sample.force, sample.moment
    assert [force.x, force.y, force.z, moment.x, moment.y, moment.z] == wrench
    assert sample.force_norm == pytest.approx(np.linalg.norm(wrench[:3]))
    assert sample.moment_norm == pytest.approx(np.linalg.norm(wrench[3:]))


def test_every_sample_of_the_sensor_is_told_at_its_own_time_as_a_load_on_the_peg() -> None:
    workcell = cell(force_torque={"reports": "reaction"})
    rows = tuple((float(row), 0.0, 1.0, 0.0, 0.0, 0.25) for row in range(10))
    told = told_by(workcell, (WRENCH_RAW, RawWrenchBatch(stamp_ns=7_000_000, period_ns=1_000_000, samples=rows)))
    samples = told["/foxglove/wrench/raw"]
    assert [stamp_ns for stamp_ns, _ in samples] == [7_000_000 + index * 1_000_000 for index in range(10)]
    assert [read(told, "wrench/raw", index).force.x for index in range(10)] == [-float(row) for row in range(10)]


def volume_m3(mesh: TriangleMesh) -> float:
    """By the divergence theorem: right only where the surface is closed and its triangles look outward."""
    a, b, c = (mesh.corners_m[mesh.triangles[:, index]] for index in range(3))
    return float(np.sum(np.cross(a, b) * c) / 6.0)


def test_frames_never_go_back_in_time_where_a_wrench_overtakes_the_joints() -> None:
    def joints(stamp_ns: int) -> JointState:
        return JointState(stamp_ns=stamp_ns, joints_rad=(0.1,) * 6, speeds_rad_s=(0.0,) * 6)

    batch = RawWrenchBatch(stamp_ns=504_000_000, period_ns=1_000_000, samples=((0.0,) * 6,))
    told = told_by(
        Workcell(), (WRENCH_RAW, batch), (JOINT_STATE, joints(503_000_000)), (JOINT_STATE, joints(524_000_000)),
        (JOINT_STATE, joints(1_000_000)),
    )  # fmt: skip
    # the last one is of a cell that was started again: its time begins anew
    assert [stamp_ns for stamp_ns, _ in told["/foxglove/transforms"]] == [504_000_000, 524_000_000, 1_000_000]


@pytest.mark.parametrize("outline", ["cross", "star", "hexagon", "keyway", "round"])
def test_peg_and_plate_are_the_solids_of_the_drawing(outline: str) -> None:
    workcell = cell(peg={"outline": outline})
    peg = workcell.peg.shape()
    hole = workcell.hole.shape(peg)
    body_m = peg.taper_start_m - peg.body_start_m
    scale = float(peg.scale_at(peg.tip_m))
    tapered_m = peg.taper_length_m * (1.0 + scale + scale**2) / 3.0
    assert volume_m3(peg_mesh(peg)) == pytest.approx(peg.outline.area_m2 * (body_m + tapered_m), rel=1e-9)
    # the chamfer recedes linearly, so Simpson's rule has its volume exactly
    areas = [Polygon(hole.outline.grown(back).corners_m).area for back in (0.0, hole.chamfer_m / 2, hole.chamfer_m)]
    opening = hole.chamfer_m * (areas[0] + 4 * areas[1] + areas[2]) / 6 + (hole.depth_m - hole.chamfer_m) * areas[0]
    plate = (2 * hole.plate_half_size_m) ** 2 * hole.depth_m
    assert volume_m3(plate_mesh(hole)) == pytest.approx(plate - opening, rel=1e-9)


POINTS = np.array([[0.02, -0.03, 0.4], [-0.1, 0.05, 0.5], [0.0, 0.0, 0.3], [0.12, 0.1, 0.6]])


@pytest.mark.parametrize(
    "numbers", [(), (-0.1, 0.02, 1e-3, -2e-3, 0.01), (0.2, -0.1, 1e-3, 1e-3, 0.02, 0.1, 0.03, 0.01)]
)
def test_points_are_where_opencv_sees_them(numbers: tuple[float, ...]) -> None:
    kind = DistortionModel.PLUMB_BOB if numbers else DistortionModel.NONE
    camera = CameraModel(width_px=640, height_px=480, fx_px=600.0, fy_px=610.0, cx_px=320.0, cy_px=240.0,
                         distortion_model=kind, distortion=numbers)  # fmt: skip
    k = np.array([[600.0, 0.0, 320.0], [0.0, 610.0, 240.0], [0.0, 0.0, 1.0]])
    expected, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), k, np.array(numbers or [0.0] * 4))
    assert np.allclose(pixels_of(camera, POINTS), expected.reshape(-1, 2), atol=1e-9)


def test_a_fisheye_sees_them_as_opencv_does_and_none_behind_it() -> None:
    numbers = (0.05, -0.01, 0.003, -0.001)
    camera = CameraModel(width_px=640, height_px=480, fx_px=300.0, fy_px=310.0, cx_px=320.0, cy_px=240.0,
                         distortion_model=DistortionModel.FISHEYE, distortion=numbers)  # fmt: skip
    k = np.array([[300.0, 0.0, 320.0], [0.0, 310.0, 240.0], [0.0, 0.0, 1.0]])
    expected, _ = cv2.fisheye.projectPoints(POINTS[:, None], np.zeros(3), np.zeros(3), k, np.array(numbers))
    assert np.allclose(pixels_of(camera, POINTS), expected.reshape(-1, 2), atol=1e-9)
    assert np.isnan(pixels_of(camera, np.array([[0.1, 0.1, -0.4]]))).all()


numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)


@given(vectors.map(lambda v: 20.0 * v), vectors.map(lambda v: 0.03 * v))
def test_an_arrow_ends_on_the_line_along_which_the_force_acts(force_n: Any, point_m: Any) -> None:
    tip_m = 0.08
    found = line_of_action(force_n, np.cross(point_m, force_n), tip_m)
    assert found[2] == pytest.approx(tip_m) and np.hypot(found[0], found[1]) <= FAR_M
    if np.hypot(found[0], found[1]) > 0.0:
        assert np.allclose(np.cross(found, force_n), np.cross(point_m, force_n), atol=1e-9)


@given(vectors.filter(lambda v: np.linalg.norm(v) > 1e-3), st.sampled_from([(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)]))
def test_a_primitive_looks_the_way_it_is_told(direction: Any, axis: tuple[float, float, float]) -> None:
    turn = along(direction, np.zeros(3), axis).orientation
    looks = Pose.from_quaternion([turn.x, turn.y, turn.z, turn.w], np.zeros(3)).rotate(axis)
    assert np.allclose(looks, direction / np.linalg.norm(direction), atol=1e-6)


HOLE = PoseData.of(Pose.from_rotvec([0.1, 1.5, 0.2], [0.41, -0.29, 0.21]))


def test_the_hole_is_drawn_where_it_is_believed_with_its_uncertainty() -> None:
    workcell, sds = cell(), np.array([1e-4, 2e-4, 3e-4, 0.01, 0.01, 0.02])
    found = HoleEstimate(
        stamp_ns=2_000_000_000, pose_base_hole=HOLE, covariance=tuple(np.diag(sds**2).ravel().tolist()),
        method=LocateMethod.RIM, orientation_measured=True, capture_id=1, capture_wall_s=0.0,
    )  # fmt: skip
    told = told_by(workcell, joints(workcell), (LOCATE.reply_echo, found), joints(workcell, 2_100_000_000))
    before, after = (
        next(pose_of(frame) for frame in read(told, "transforms", index).transforms if frame.child_frame_id == "hole")
        for index in (0, -1)
    )
    assert before.distance_to_m(workcell.hole_prior.pose_base_hole()) < 1e-12
    assert after.distance_to_m(HOLE.pose()) < 1e-12
    (ball,) = (sphere for entity in read(told, "scene/estimate").entities for sphere in entity.spheres)
    sizes = sorted([ball.size.x, ball.size.y, ball.size.z])
    assert sizes == pytest.approx((2.0 * MAGNIFIED * np.sqrt(CHI2_95_OF_3) * sds[:3]).tolist())


def test_only_topics_of_the_truth_hold_the_truth() -> None:
    workcell = cell()
    true = SimulationTruth(
        stamp_ns=1_600_000_000, seed=1, pose_base_hole=HOLE, pose_base_peg=HOLE, wrench_contact=(0.0,) * 6,
        contacts=(TrueContact(point_base_m=(0.1, 0.2, 0.3), force_base_n=(0.0, 0.0, 5.0)),),
    )  # fmt: skip
    said = [joints(workcell), joints(workcell, 1_700_000_000)]
    without, with_truth = told_by(workcell, *said), told_by(workcell, said[0], (TRUTH, true), said[1])
    assert {name: rows for name, rows in with_truth.items() if not name.startswith(TRUTH_PREFIX)} == without
    assert {name for name in with_truth if name not in without} == {
        f"{TRUTH_PREFIX}{name}" for name in ("transforms", "rim", "contacts")
    }
    assert TRUTH not in HEARD and TRUTH_HEARD == (TRUTH,)


def test_events_touches_and_forces_are_shown() -> None:
    workcell = cell()
    state = ContactState(case="1-1-1", n_z0=0.9, confidence=0.8)
    touch = Touch(
        stamp_ns=1_000_000_000, index=3, pose_base_peg=HOLE, direction_base=(1.0, 0.0, 0.0),
        joints_rad=workcell.home_joints_rad, wrench=(1.0, 0.0, -6.0, 0.0, 0.1, 0.0), wrench_sd=(0.1,) * 6, state=state,
    )  # fmt: skip
    felt = ContactWrench(
        stamp_ns=1_000_000_000, wrench=(1.0, 0.0, -6.0, 0.0, 0.1, 0.0), in_contact=True, free_residual_n=0.1,
        drift_suspected=False,
    )  # fmt: skip
    event = Event(stamp_ns=1_000_000_000, service="vision", severity=Severity.WARNING, code="glare", text="too bright")
    told = told_by(workcell, (TOUCH, touch), (CONTACT_WRENCH, felt), (EVENTS, event))
    (marks,) = read(told, "scene/touches").entities
    assert [text.text for text in marks.texts] == ["3: 1-1-1"] and len(marks.arrows) == 1
    assert len(read(told, "path/touches").poses) == 1
    (forces,) = read(told, "scene/force").entities
    assert len(forces.arrows) == 2 and forces.frame_id == "peg" and forces.frame_locked
    log = read(told, "log")
    assert (log.name, log.message, log.level) == ("vision", "glare: too bright", 3)


def test_each_well_known_schema_is_the_packages_own() -> None:
    for topic in viewer_topics():
        if topic.schema != WRENCH_SAMPLE:
            name = topic.schema.removeprefix("foxglove.")
            known = getattr(import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)
            assert [field.name for field in BY_NAME[topic.name].DESCRIPTOR.fields] == [
                field.name for field in known.DESCRIPTOR.fields
            ]
