"""A recording of an assembly that never was, from hand-made messages: for trying the report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.arm.inverse import nearest
from crosspih_common.bus.codec import encode
from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.keys import (
    ANNOTATED_LEFT,
    ANNOTATED_RIGHT,
    ASSEMBLE,
    CONTACT_WRENCH,
    ESTIMATE,
    EVENTS,
    FT_CALIBRATION,
    JOINT_STATE,
    PHASE,
    STATUS,
    TOUCH,
    TRUTH,
    WRENCH_RAW,
    Topic,
)
from crosspih_common.messages import (
    Assemble,
    AssemblyPhase,
    AssemblyResult,
    ContactState,
    ContactWrench,
    Event,
    FtCalibration,
    Image,
    JointState,
    Phase,
    PoseData,
    PoseErrorEstimate,
    RawWrenchBatch,
    ServiceState,
    ServiceStatus,
    Severity,
    SimulationTruth,
    Touch,
    TouchUse,
    floats,
    strategy_of,
)
from crosspih_common.wrench import Payload
from services.recorder.config import RecorderConfig
from services.recorder.file import RecordingFile
from services.recorder.sample import Sample

CELL_YAML = "cell:\n  name: synth\n  insertion_depth_m: 0.015\n"
HOLE = Workcell().hole_prior.pose_base_hole()
STEPS = (
    (0.0, Phase.LOCATING, "the hole at 0.4003 -0.2996 0.2001 m, tilted 4.1 deg"),
    (0.0, Phase.APPROACHING, "to 20 mm before the hole"),
    (3.1, Phase.PUSHING, "pushes in, yielding"),
    (5.0, Phase.TOUCHING, "touch 1 from the middle"),
    (6.4, Phase.ESTIMATING, "estimates the hole from 1 touch"),
    (6.4, Phase.TOUCHING, "touch 2 from the left"),
    (8.1, Phase.ESTIMATING, "estimates the hole from 2 touches"),
    (8.1, Phase.CORRECTING, "moves by 0.4 mm and 1.1 deg"),
    (8.9, Phase.PUSHING, "pushes in, yielding"),
    (12.2, Phase.SEATED, "seated 16.2 mm deep"),
    (12.4, Phase.DONE, "inserted"),
)
SECOND = 1_000_000_000
START_NS = 40 * SECOND


class SyntheticRecording:
    """Adds samples to a recording; `finish` writes what belongs at its end."""

    def __init__(self, path: Path, cell_yaml: str = CELL_YAML) -> None:
        self.file = RecordingFile(
            path, path.open("xb"), RecorderConfig(), {"cell": {"name": "synth", "yaml": cell_yaml}}
        )
        self._numbers: dict[str, int] = {}
        self._wall_ns = 1_700_000_000 * SECOND

    def add(self, topic: Topic[Any], value: Any, service: str = "*") -> None:
        key = topic.key("synth", service)
        seq = self._numbers.get(key, 0)
        self._numbers[key] = seq + 1
        self._wall_ns += 1_000_000
        if isinstance(value, Image):
            value = Image(value.frame, value.pixels, value.stamp_ns, seq, value.encoding)
        else:
            value = value.model_copy(update={"seq": seq})
        self.file.write(Sample(key, topic, encode(value), seq, value.stamp_ns, self._wall_ns))

    def finish(self) -> None:
        self.file.finish({"drops": {"overflow_total": "0", "gaps_total": "0"}})


def at(time_s: float) -> int:
    return START_NS + round(time_s * SECOND)


def seen(frame: str, shift: int) -> Image:
    rows, columns = np.mgrid[0:480, 0:640]
    pixels = np.repeat((120 + 40 * np.sin(rows / 60) + 0 * columns)[:, :, None], 3, axis=2).astype(np.uint8)
    pixels[160:320, 300 + shift : 340 + shift] = 25
    pixels[220:260, 240 + shift : 400 + shift] = 25
    pixels[158:160, 300 + shift : 340 + shift] = (80, 220, 80)
    return Image(frame, pixels, at(0.0))


def wrench_at(time_s: float, rng: np.random.Generator) -> tuple[float, ...]:
    force = np.zeros(6)
    if 4.0 < time_s < 5.0 or 6.0 < time_s < 6.4 or 7.7 < time_s < 8.1:
        force = np.array([-6.0, -0.8, -14.0, -0.05, -0.9, 0.3])
    elif 9.6 < time_s < 12.2:
        force = np.array([1.0, -2.0, -4.0 - 3.0 * np.sin(3.0 * time_s), 0.1, -0.1, 0.02])
    return floats(force + rng.normal(0.0, [0.1] * 3 + [0.005] * 3))


def touch(index: int, time_s: float, seated: bool = False) -> Touch:
    return Touch(
        stamp_ns=at(time_s),
        index=index,
        seated=seated,
        pose_base_peg=PoseData.of(HOLE),
        direction_base=(1.0, 0.0, 0.0),
        joints_rad=(0.0,) * 6,
        wrench=(-6.0, -0.8, -14.0, -0.05, -0.9, 0.3),
        wrench_sd=(0.02,) * 6,
        state=ContactState(stamp_ns=at(time_s), case="1-2-2", count=1, sense=2, n_z0=0.9, confidence=0.87),
    )


def estimate(time_s: float, off_m: float, count: int) -> PoseErrorEstimate:
    return PoseErrorEstimate(
        stamp_ns=at(time_s),
        pose_base_hole=PoseData.of(HOLE @ Pose.from_rotvec([0.0, off_m * 10, 0.0], [off_m, 0.0, 0.0])),
        covariance=(0.0,) * 36,
        angles_rad=(0.01, -0.02, 0.005),
        translation_m=(0.0004, -0.0001, 0.03),
        rank=2 + count,
        residual_cost=1.2,
        friction=0.19,
        friction_sd=0.02,
        method="map",
        rests_on=tuple(
            TouchUse(index=i, used=True, hypothesis="arm 2 on the rim", residual_sigma=0.8) for i in range(count)
        ),
        compute_s=0.02,
    )


def raw_samples(recording: SyntheticRecording, push_n: float) -> None:
    """What the sensor and the encoders say from 0 to 12.4 s, at 200 Hz: the arm stands in front of the hole and then in
    it, the tool's weight of 8 N is felt throughout, and from 9 to 12 s a force of `push_n` against the peg's tip."""
    cell, calibration = Workcell(), FtCalibration(
        stamp_ns=at(-5.0), bias=(0.5, -0.2, 0.1, 0.01, 0.0, 0.0), weight_n=8.0, centroid_m=(0.0, 0.0, 0.03),
        gravity_base=(0.0, 0.0, -1.0), residual_force_n=0.01, residual_moment_nm=0.001, poses=6,
    )  # fmt: skip
    recording.add(FT_CALIBRATION, calibration)
    outside, inside = (posture(depth_m) for depth_m in (-0.02, 0.01))
    mounting = cell.sensor_mounting()
    payload = Payload(
        np.array(calibration.bias), np.array([0.0, 0.0, -8.0]), np.array(calibration.centroid_m), mounting
    )
    for step in range(248):
        time_s = step * 0.05
        joints = outside if time_s < 8.5 else inside
        recording.add(JOINT_STATE, JointState(stamp_ns=at(time_s), joints_rad=joints, speeds_rad_s=(0.0,) * 6))
        contact = np.zeros((10, 6))
        if 9.0 <= time_s < 12.0:
            contact[:, 2] = -push_n * np.sin(np.pi * (time_s - 9.0 + 0.005 * np.arange(10)) / 3.0)
        load = payload.load(cell.pose_base_peg(joints).rotation)
        raw = mounting.raw(contact + load)
        batch = RawWrenchBatch(stamp_ns=at(time_s), period_ns=5_000_000, samples=tuple(floats(row) for row in raw))
        recording.add(WRENCH_RAW, batch)


def posture(depth_m: float) -> tuple[float, ...]:
    """Joints with which the peg's tip is that deep in the hole, on its axis."""
    cell = Workcell()
    peg = HOLE @ Pose.from_translation([0.0, 0.0, depth_m - cell.peg.shape().tip_m])
    return floats(nearest(cell.arm(), peg @ cell.pose_flange_peg().inverse(), np.array(cell.home_joints_rad)))


def write_assembly(
    path: Path,
    *,
    inserted: bool = True,
    finish: bool = True,
    presses: int = 0,
    push_n: float | None = None,
    told_touches: int = 2,
    strategy: str = "fused",
    saw: bool = True,
    cell_yaml: str = CELL_YAML,
) -> None:
    """A whole assembly, 12.4 s long, with two touches, and presses once seated; with `push_n` the sensor's own samples
    are in it too, and its peak is that force."""
    recording, rng = SyntheticRecording(path, cell_yaml), np.random.default_rng(3)
    drawing = Workcell()
    # the body's end is 16.2 mm past the chamfer when the assembly is over
    shoulder_m = drawing.peg.shape().taper_start_m
    peg = HOLE @ Pose.from_translation([0.0, 0.0, 0.0162 + drawing.hole.chamfer_m - shoulder_m])
    recording.add(
        TRUTH,
        SimulationTruth(
            stamp_ns=at(-1.0),
            seed=42,
            pose_base_hole=PoseData.of(HOLE),
            pose_base_peg=PoseData.of(peg),
            wrench_contact=(0.0,) * 6,
        ),
    )
    recording.add(ASSEMBLE.request_echo, Assemble(stamp_ns=at(0.0)))
    if saw:
        recording.add(ANNOTATED_LEFT, seen("camera_left", 0))
        recording.add(ANNOTATED_RIGHT, seen("camera_right", -40))
    events: list[tuple[float, Topic[Any], Any]] = []
    for time_s, phase, text in STEPS:
        figures = {"force_n": 12.5} if phase is Phase.PUSHING else {}
        message = AssemblyPhase(
            stamp_ns=at(time_s), assembly_id="s", phase=phase, attempt=1, text=text, figures=figures
        )
        events.append((time_s, PHASE, message))
    for index, time_s in enumerate((6.4, 8.1)):
        events.append((time_s - 0.01, TOUCH, touch(index, time_s - 0.01)))
        events.append((time_s, ESTIMATE.reply_echo, estimate(time_s, 0.0006 / (index + 1) ** 2, index + 1)))
    for index in range(presses):
        time_s = 12.21 + 0.01 * index
        events.append((time_s, TOUCH, touch(2 + index, time_s, seated=True)))
    for step in range(1240):
        time_s = step * 0.01
        wrench = ContactWrench(
            stamp_ns=at(time_s),
            wrench=wrench_at(time_s, rng),
            in_contact=False,
            free_residual_n=0.05,
            drift_suspected=False,
        )
        events.append((time_s, CONTACT_WRENCH, wrench))
    if push_n is not None:
        raw_samples(recording, push_n)
    for _, topic, message in sorted(events, key=lambda event: event[0]):
        recording.add(topic, message)
    for service in ("hardware", "planning"):
        status = ServiceStatus(stamp_ns=at(12.0), service=service, state=ServiceState.READY, pid=1, uptime_s=30.0)
        recording.add(STATUS, status, service)
    warning = Event(
        stamp_ns=at(5.0), service="vision", severity=Severity.WARNING, code="dark", text="<b>rather</b> dark"
    )
    recording.add(EVENTS, warning, "vision")
    if finish:
        recording.add(ASSEMBLE.reply_echo, result(inserted, presses, told_touches, strategy, saw))
        recording.finish()
    else:
        recording.file.flush()
        recording.file.abandon()


def result(
    inserted: bool, presses: int = 0, touches: int = 2, strategy: str = "fused", saw_hole: bool = True
) -> AssemblyResult:
    found = HOLE @ Pose.from_rotvec([0.001, 0.0, 0.0], [0.00003, -0.00002, 0.0001])
    saw = HOLE @ Pose.from_rotvec([0.012, -0.004, 0.0], [0.0002, 0.0001, -0.0006])
    return AssemblyResult.model_validate(
        {
            "stamp_ns": at(12.4),
            "assembly_id": "s",
            "strategy": strategy_of(strategy),
            "inserted": inserted,
            "failure": None if inserted else "not_converged",
            "failure_detail": "" if inserted else "5 pushes did not enter",
            "backed_off": not inserted,
            "pose_base_hole": PoseData.of(found),
            "pose_base_peg": PoseData.of(found),
            "vision_pose_base_hole": PoseData.of(saw) if saw_hole else None,
            "motion_s": 12.4,
            "thinking_s": 0.31,
            "touches": touches,
            "presses": presses,
            "corrections": 1,
            "pushes": 2,
            "peak_force_n": 15.31,
            "peak_moment_nm": 1.02,
            "insertion_depth_m": 0.0162,
        }
    )
