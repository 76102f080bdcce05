"""The cameras of the simulated cell: they expose on the cell's clock and see the trial's hole, light and arm."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration
from crosspih_common.messages.base import PoseData
from services.hardware.config import CameraConfig
from services.hardware.simulation.arm import SimulatedArm
from services.hardware.simulation.camera import SensorQuality, SimulatedScene
from services.hardware.simulation.camera_rig import StereoRig
from services.hardware.simulation.physics import STEP_S
from services.hardware.simulation.scene_appearance import Appearance
from services.hardware.simulation.servo import Servo


class SimulatedStereoCamera:
    """Implements the StereoCamera protocol. The scene is made at the first picture: not every cell takes one."""

    def __init__(self, workcell: Workcell, config: CameraConfig, servo: Servo, arm: SimulatedArm) -> None:
        self._config = config
        self._servo = servo
        self._arm = arm
        self._rig = StereoRig()
        peg = workcell.peg.shape()
        self._make: Callable[[], SimulatedScene] = lambda: SimulatedScene(
            workcell.hole.shape(peg), self._rig, peg, workcell.arm(),
            SensorQuality(config.samples, config.blur_px, config.noise_grey),
        )  # fmt: skip
        self._scene: SimulatedScene | None = None
        self._pose_base_hole = Pose.identity()
        self._rng = np.random.default_rng(0)
        self._look = Appearance.draw(self._rng)

    def start(self, pose_base_hole: Pose, rng: np.random.Generator) -> None:
        """A new trial: another hole, light and noise."""
        self._pose_base_hole = pose_base_hole
        self._rng = rng
        self._look = Appearance.draw(rng)

    def calibration(self) -> CameraCalibration:
        """What the cameras are and where they stand."""
        rig = self._rig
        return CameraCalibration(
            stamp_ns=self._servo.now_ns,
            width_px=rig.width,
            height_px=rig.height,
            fx_px=rig.fx,
            fy_px=rig.fy,
            cx_px=rig.cx,
            cy_px=rig.cy,
            baseline_m=rig.baseline_m,
            pose_base_camera=PoseData.of(rig.pose_base_camera),
        )

    def capture(self) -> tuple[int, float, NDArray[np.uint8], NDArray[np.uint8]]:
        """Expose for the configured time of the cell's clock; waits for a motion to end first."""
        with self._arm.between_motions():
            stamp_ns = self._servo.now_ns
            self._arm.hold_still(max(1, round(self._config.exposure_s / STEP_S)))
            if self._scene is None:
                self._scene = self._make()
            left, right = self._scene.render_stereo(
                self._pose_base_hole, self._servo.joints_rad, self._rng, appearance=self._look
            )
            return stamp_ns, self._config.exposure_s, left, right

    def close(self) -> None:
        """Let the scene go; a second call does nothing."""
        if self._scene is not None:
            self._scene.close()
            self._scene = None
