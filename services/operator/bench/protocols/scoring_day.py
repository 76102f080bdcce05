"""The results of the calibrations of a cell against its hidden errors. Pure."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration
from services.operator.bench.protocols.hidden import true_cameras

DEG = 180.0 / np.pi


@dataclass(frozen=True, slots=True)
class DayFigure:
    """One number: its error before and after the calibration, in `unit`."""

    what: str
    before: float
    after: float
    unit: str

    def as_json(self) -> dict[str, Any]:
        """For `--json`."""
        return asdict(self)


def _off(one: Pose, true: Pose) -> tuple[float, float]:
    """Distance, mm, and angle, degrees."""
    away = true.inverse() @ one
    return float(np.linalg.norm(away.translation_m)) * 1e3, float(np.linalg.norm(away.rotvec_rad())) * DEG


def _pose_rows(what: str, before: Pose, after: Pose, true: Pose) -> list[DayFigure]:
    pairs = zip(_off(before, true), _off(after, true), ("place", "turn"), ("mm", "°"), strict=True)
    return [DayFigure(f"{what}, {kind}", first, then, unit) for first, then, kind, unit in pairs]


def _focal_off_px(one: CameraCalibration, true: CameraCalibration) -> float:
    return max(abs(one.left.fx_px - true.left.fx_px), abs(one.right.fx_px - true.right.fx_px))


def _middle_off_px(one: CameraCalibration, true: CameraCalibration) -> float:
    pairs = (one.left, true.left), (one.right, true.right)
    return max(float(np.hypot(mine.cx_px - real.cx_px, mine.cy_px - real.cy_px)) for mine, real in pairs)


def camera_rows(before: CameraCalibration, after: CameraCalibration, behind: dict[str, Any]) -> list[DayFigure]:
    """Lenses, the right camera, the left one in the base."""
    true = true_cameras(behind)
    beside = [one.pose_left_right.pose() for one in (before, after, true)]
    stands = [one.pose_base_camera.pose() for one in (before, after, true)]
    return [
        DayFigure("stereo, focal length, worse of both", _focal_off_px(before, true), _focal_off_px(after, true), "px"),
        DayFigure("stereo, picture's middle, worse of both", _middle_off_px(before, true), _middle_off_px(after, true),
              "px"),
        *_pose_rows("stereo, right camera", beside[0], beside[1], beside[2]),
        *_pose_rows("hand-eye, left camera", stands[0], stands[1], stands[2]),
    ]  # fmt: skip


def true_tool(behind: dict[str, Any]) -> tuple[Pose, Pose, np.ndarray[Any, np.dtype[np.float64]]]:
    """The peg and the sensor on the flange, and the joints' stiffness (n,), as they really are."""
    cell, truth = Workcell.model_validate(behind["cell"]), behind["hardware"]["simulated"]["truth"]
    peg = cell.pose_flange_peg()
    sensor = peg @ Pose.from_rotvec(truth["ft_turn_rad"], truth["ft_shift_m"])
    stiffness = np.asarray(cell.joint_stiffness_nm_rad) * np.asarray(truth["joint_stiffness_factors"])
    return peg @ Pose.from_translation(truth["peg_shift_m"]), sensor, stiffness


def tool_rows(before: Workcell, after: Workcell, behind: dict[str, Any]) -> list[DayFigure]:
    """The tip, the sensor's mounting, the joints' stiffness."""
    peg, sensor, stiffness = true_tool(behind)
    tips = [_off(one.pose_flange_peg(), peg)[0] for one in (before, after)]
    mounted = [one.pose_flange_peg() @ one.sensor_mounting().pose_peg_sensor for one in (before, after)]
    rows = [DayFigure("tcp, tip", tips[0], tips[1], "mm"), *_pose_rows("mount, sensor", mounted[0], mounted[1], sensor)]
    off = [np.asarray(one.joint_stiffness_nm_rad) / stiffness - 1.0 for one in (before, after)]
    rows += [
        DayFigure(f"stiffness, joint {joint + 1}", float(off[0][joint]) * 100.0, float(off[1][joint]) * 100.0, "%")
        for joint in range(len(stiffness))
    ]
    return rows


def truth_lines(behind: dict[str, Any]) -> list[str]:
    """The hidden errors, for people."""
    cameras = true_cameras(behind)
    peg, sensor, stiffness = true_tool(behind)

    def said(pose: Pose) -> str:
        place = ", ".join(f"{value * 1e3:.3f}" for value in pose.translation_m)
        return f"({place}) mm, ({', '.join(f'{value * DEG:.3f}' for value in pose.rotvec_rad())})°"

    return [
        f"left camera in the base   {said(cameras.pose_base_camera.pose())}",
        f"right camera in the left  {said(cameras.pose_left_right.pose())}",
        f"focal length              {cameras.left.fx_px:.2f} px, middle {cameras.left.cx_px:.2f}, "
        f"{cameras.left.cy_px:.2f}",
        f"peg on the flange         {said(peg)}",
        f"sensor on the flange      {said(sensor)}",
        f"joints' stiffness         {', '.join(f'{value:.0f}' for value in stiffness)} Nm/rad",
    ]
