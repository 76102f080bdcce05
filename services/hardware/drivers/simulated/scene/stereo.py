"""The cameras of the simulated cell: they expose on the cell's clock and see the trial's hole, light and arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration, CaptureStereo, SceneFaults
from crosspih_common.messages.base import PoseData
from services.hardware.control.arm import SimulatedArm
from services.hardware.control.servo import Servo
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.engines.pybullet.engine import STEP_S
from services.hardware.drivers.simulated.scene.camera import SensorQuality, SimulatedScene
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.hardware.drivers.simulated.scene.scene_appearance import Appearance, Faults
from services.hardware.drivers.simulated.truth import true_camera, true_hole, true_peg


class SimulatedStereoCamera:
    """Implements the StereoCamera protocol. The scene is made at the first picture: not every cell takes one."""

    def __init__(self, workcell: Workcell, simulated: SimulatedConfig, servo: Servo, arm: SimulatedArm) -> None:
        self._config = config = simulated.camera
        self._servo = servo
        self._arm = arm
        self._rig = StereoRig()
        truth = simulated.truth
        true_rig = replace(self._rig, pose_base_camera=true_camera(self._rig.pose_base_camera, truth))
        self._make: Callable[[], SimulatedScene] = lambda: SimulatedScene(
            true_hole(workcell, truth), true_rig, true_peg(workcell, truth), workcell.arm(),
            SensorQuality(config.samples, config.blur_px, config.noise_grey),
        )  # fmt: skip
        self._scene: SimulatedScene | None = None
        self._pose_base_hole = Pose.identity()
        self._rng = np.random.default_rng(0)
        self._look = Appearance.draw(self._rng)
        self._faults = Faults()

    def start(self, pose_base_hole: Pose, rng: np.random.Generator, scene: SceneFaults | None = None) -> None:
        """A new trial: another hole, light and noise; `scene` is what is wrong in front of the cameras."""
        self._pose_base_hole = pose_base_hole
        self._faults = Faults() if scene is None else Faults(**scene.model_dump())
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

    def capture(self, command: CaptureStereo) -> tuple[int, float, NDArray[np.uint8], NDArray[np.uint8]]:
        """Expose for the asked time of the cell's clock; waits for a motion to end first."""
        with self._arm.between_motions():
            stamp_ns = self._servo.now_ns
            exposure_s = self._config.exposure_s * command.exposure_scale
            self._arm.hold_still(max(1, round(exposure_s / STEP_S)))
            if self._scene is None:
                self._scene = self._make()
            left, right = self._scene.render_stereo(
                self._pose_base_hole,
                self._servo.joints_rad,
                self._rng,
                self._faults_under(command),
                self._look if command.lamp == 0 else self._look.under_another_lamp(command.lamp),
            )
            return stamp_ns, exposure_s, left, right

    def _faults_under(self, command: CaptureStereo) -> Faults:
        """What is wrong in front of the cameras, as it looks with that exposure and that lamp lit."""
        faults = self._faults
        # a flat plate throws the light of one lamp into the cameras, not that of another
        glare = faults.glare + self._config.glare if command.lamp == 0 else 0.0
        return replace(
            faults,
            light_scale=faults.light_scale * self._config.brightness * command.exposure_scale,
            glare=glare * command.exposure_scale,
        )

    def close(self) -> None:
        """Let the scene go; a second call does nothing."""
        if self._scene is not None:
            self._scene.close()
            self._scene = None
