"""Reads from a recording: touches, presses, the pose found by vision and the final pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.config import CellFile, SensorSection, Workcell, with_correction_moved
from crosspih_common.errors import CrosspihError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.wrench import adjoint_wrench
from crosspih_common.keys import ASSEMBLE, CAPTURE, ESTIMATE, IDENTIFY_PAYLOAD, LOCATE, TOUCH
from crosspih_common.messages import IdentifyPayload, LocateMethod, Touch
from crosspih_common.plain_yaml import yaml_of
from crosspih_common.recording.reader import Recording, read_recording
from services.inference.estimator import TouchObservation

TOPICS = (
    ASSEMBLE.reply_echo, CAPTURE.reply_echo, ESTIMATE.request_echo, ESTIMATE.reply_echo,
    IDENTIFY_PAYLOAD.request_echo, LOCATE.reply_echo, TOUCH,
)  # fmt: skip
# sections that must be the same in the recording's cell and in the cell to refine
SAME = ("arm_section", "peg", "hole", "flange_to_ft", "flange_to_ft_m", "joint_stiffness_nm_rad", "gravity_base_m_s2")


class NothingToRefine(CrosspihError):
    """The recordings hold nothing to refine with, or belong to another cell."""


@dataclass(frozen=True, slots=True, eq=False)
class SeenHole:
    """The hole as vision saw it: in the left camera's frame, with its covariance (6, 6) (hole frame), and the
    calibrated pose of the camera."""

    pose_camera_hole: Pose
    covariance: Array
    pose_base_camera: Pose


@dataclass(frozen=True, slots=True, eq=False)
class AssemblyData:
    """One successful assembly. Wrenches of touches and presses are on the peg, as a sensor without a correction would
    report them.

    pose_base_hole: T2, a start for the fit. touches: before the insertion; presses: against the bore's walls.
    """

    name: str
    pose_base_hole: Pose
    touches: tuple[TouchObservation, ...]
    presses: tuple[TouchObservation, ...]
    seen: SeenHole | None


@dataclass(frozen=True, slots=True, eq=False)
class Weighing:
    """The dwells of one calibration of the sensor: rotation_base_peg (n, 3, 3); force (n, 3) including bias and weight,
    peg frame, N, and its sd, N."""

    rotation_base_peg: Array
    force_n: Array
    sd_n: Array


@dataclass(frozen=True, slots=True, eq=False)
class RecordedAssemblies:
    """The data of all recordings, and what was left out and why."""

    assemblies: tuple[AssemblyData, ...]
    weighings: tuple[Weighing, ...]
    left_out: tuple[str, ...]


def camera_correction(cell: dict[str, Any]) -> Pose:
    """The correction of the left camera in a cell's file (in the camera's own frame)."""
    return _pose((cell.get("vision") or {}).get("camera_correction"))


def sensor_correction(cell: dict[str, Any]) -> Pose:
    """The correction of the sensor's frame in a cell's file, in the peg frame."""
    return _pose(((cell.get("cell") or {}).get("force_torque") or {}).get("correction"))


def _pose(section: dict[str, Any] | None) -> Pose:
    section = section or {}
    return Pose.from_rotvec(section.get("turn_rad", (0.0,) * 3), section.get("shift_m", (0.0,) * 3))


def read_past(cell: CellFile, paths: Sequence[Path], tell: Callable[[str, int, int], None]) -> RecordedAssemblies:
    """Read recordings of this cell. Raises RecordingError for a file that is no recording, and NothingToRefine if one
    belongs to another cell or none holds an assembly."""
    assemblies: list[AssemblyData] = []
    weighings: list[Weighing] = []
    left_out: list[str] = []
    for count, path in enumerate(paths):
        tell("reading recordings", count, len(paths))
        recording = read_recording(path, TOPICS)
        content = _content(recording)
        _check_same(path, cell, content)
        found = [weighing_of(request, cell.workcell) for request in recording.messages(IDENTIFY_PAYLOAD.request_echo)]
        weighings += found
        data = _assembly(recording, cell.workcell, content)
        if isinstance(data, AssemblyData):
            assemblies.append(data)
        elif not found:
            left_out.append(f"{path.name}: {data}")
    tell("reading recordings", len(paths), len(paths))
    if not assemblies:
        raise NothingToRefine(
            "no assembly that went in is in these recordings: "
            + ("; ".join(left_out) or "calibrations of the sensor alone do not do")
            + "; record some with `crosspih bench assembly --record`"
        )
    return RecordedAssemblies(tuple(assemblies), tuple(weighings), tuple(left_out))


def _content(recording: Recording) -> dict[str, Any]:
    content = yaml_of(recording.metadata.get("cell", {}).get("yaml", "")) or {}
    return with_correction_moved(content) if isinstance(content, dict) else {}


def _check_same(path: Path, cell: CellFile, content: dict[str, Any]) -> None:
    theirs = Workcell.model_validate(content.get("cell") or {})
    for name in SAME:
        if getattr(theirs, name) != getattr(cell.workcell, name):
            raise NothingToRefine(
                f"{path}: another cell's recording (its cell.{name} differs from that of {cell.path}); leave it out, "
                f"or name its cell's file with --cell"
            )
    if _uncorrected(theirs.force_torque) != _uncorrected(cell.workcell.force_torque):
        raise NothingToRefine(
            f"{path}: its sensor was mounted or read otherwise (its cell.force_torque differs from that of "
            f"{cell.path}); leave it out, or name its cell's file with --cell"
        )


def _uncorrected(sensor: SensorSection) -> tuple[object, ...]:
    """The sensor's settings without the correction, which is being refined."""
    return sensor.pose_flange_sensor, sensor.reports, sensor.axes, sensor.force_unit, sensor.moment_unit


def weighing_of(request: IdentifyPayload, workcell: Workcell) -> Weighing:
    """The dwells of a calibration; the forces as they would be in the peg frame if the sensor needed no correction."""
    readings = request.readings
    mounting = workcell.force_torque.as_drawn().mounting(workcell.pose_flange_peg())
    wrenches = np.array([reading.wrench_raw for reading in readings])
    sds = np.array([reading.wrench_sd for reading in readings])
    return Weighing(
        np.array([reading.pose_base_peg.pose().rotation for reading in readings]),
        (wrenches @ mounting.peg_of_raw.T)[:, :3],
        mounting.peg_sd(sds)[:, :3],
    )


def _assembly(recording: Recording, workcell: Workcell, content: dict[str, Any]) -> AssemblyData | str:
    """The assembly of a recording, or the reason why there is none to use."""
    result = recording.last(ASSEMBLE.reply_echo)
    if result is None:
        return "no assembly in it"
    if not result.inserted or result.pose_base_hole is None:
        return f"the assembly failed ({result.failure.value if result.failure else 'no pose'})"
    back = np.linalg.inv(adjoint_wrench(sensor_correction(content)))
    unused = _unused(recording)

    def observation(touch: Touch) -> TouchObservation:
        direction = np.asarray(touch.direction_base)
        return TouchObservation(
            touch.pose_base_peg.pose(),
            back @ np.asarray(touch.wrench),
            np.asarray(touch.wrench_sd),
            (workcell.arm_compliance_peg if touch.seated else workcell.compliance_peg)(touch.joints_rad),
            direction / np.linalg.norm(direction),
        )

    felt = recording.messages(TOUCH)
    touches = tuple(observation(touch) for touch in felt if not touch.seated and touch.index not in unused)
    presses = tuple(observation(touch) for touch in felt if touch.seated and touch.index not in unused)
    if not presses:
        return "it has no presses against the bore"
    return AssemblyData(
        recording.path.stem,
        result.pose_base_hole.pose(),
        touches,
        presses,
        _seen(recording, camera_correction(content)),
    )


def _unused(recording: Recording) -> set[int]:
    """The touches that the last estimate that included them could not explain."""
    verdicts: dict[int, bool] = {}
    for estimate in recording.messages(ESTIMATE.reply_echo):
        verdicts |= {use.index: use.used for use in estimate.rests_on}
    return {index for index, used in verdicts.items() if not used}


def _seen(recording: Recording, correction: Pose) -> SeenHole | None:
    located, pair = recording.last(LOCATE.reply_echo), recording.last(CAPTURE.reply_echo)
    if located is None or pair is None or located.method is not LocateMethod.RIM:
        return None
    camera = pair.calibration.pose_base_camera.pose()
    return SeenHole(
        (camera @ correction).inverse() @ located.pose_base_hole.pose(),
        np.asarray(located.covariance).reshape(6, 6),
        camera,
    )
