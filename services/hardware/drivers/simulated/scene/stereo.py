"""The cameras of the simulated cell: they expose on the cell's clock and see the trial's hole, light and arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, SceneFaults
from crosspih_common.messages.base import PoseData
from services.hardware.drivers.simulated.config import SimulatedConfig
from services.hardware.drivers.simulated.scene.board import ShownBoard
from services.hardware.drivers.simulated.scene.camera import PARKED, SensorQuality, SimulatedScene
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.hardware.drivers.simulated.scene.scene_appearance import Appearance, Faults
from services.hardware.drivers.simulated.truth import true_camera, true_hole, true_peg, true_right_camera
from services.hardware.drivers.simulated.world import World
from services.hardware.protocols import StereoCapture


class SimulatedStereoCamera:
    """Implements the CameraDevice protocol. The scene is made at the first picture: not every cell takes one."""

    def __init__(self, workcell: Workcell, simulated: SimulatedConfig, world: World) -> None:
        self._config = config = simulated.camera
        self._world = world
        self.exposure_s = config.exposure_s
        self._rig = StereoRig.of(workcell.camera)
        truth = simulated.truth
        parallel = Pose.from_translation([self._rig.baseline_m, 0.0, 0.0])
        beside = true_right_camera(parallel, truth)
        true_rig = replace(
            self._rig,
            pose_base_camera=true_camera(self._rig.pose_base_camera, truth),
            pose_left_right=None if beside is parallel else beside,
        )
        board = None if simulated.board is None else ShownBoard.of(simulated.board)
        hole = true_hole(workcell, truth)
        self._depth_m = hole.depth_m
        bottom_m = config.appearance.bottom_depth_m
        if bottom_m is not None and not hole.chamfer_m < bottom_m <= hole.depth_m:
            raise ConfigError(
                f"hardware.simulated.camera.appearance.bottom_depth_m: is {bottom_m:g}; want more than the chamfer's "
                f"{hole.chamfer_m:g} m and no more than the plate's {hole.depth_m:g} m"
            )
        self._make: Callable[[], SimulatedScene] = lambda: SimulatedScene(
            hole, true_rig, true_peg(workcell, truth), workcell.arm(),
            SensorQuality(config.samples, config.blur_px, config.noise_grey), workcell.pose_flange_peg(),
            board=board,
        )  # fmt: skip
        self._scene: SimulatedScene | None = None
        self._pose_base_hole = Pose.identity()
        self._rng = np.random.default_rng(0)
        self._look = self._drawn()
        self._faults = Faults()
        self._pose_base_board: Pose | None = None

    def arm_stands_at(self, joints_rad: Array) -> None:
        """For cameras whose arm is another process's: its joints (n,)."""
        self._world.joints_rad = joints_rad

    def board_at(self, pose_base_board: Pose | None, there: bool = True) -> None:
        """Where somebody holds the board; None: clamped to the flange. `there` false: it was put away."""
        self._pose_base_board = pose_base_board if there else PARKED

    def start(self, pose_base_hole: Pose, rng: np.random.Generator, scene: SceneFaults | None = None) -> None:
        """A new trial: another hole, light and noise; `scene` is what is wrong in front of the cameras."""
        self._pose_base_hole = pose_base_hole
        self._faults = Faults() if scene is None else Faults(**scene.model_dump())
        self._rng = rng
        self._look = self._drawn()

    def _drawn(self) -> Appearance:
        return Appearance.draw(self._rng, self._config.appearance, self._depth_m)

    def calibration(self) -> CameraCalibration:
        """What the cameras are and where they stand."""
        rig = self._rig
        left, right = rig.models()
        return CameraCalibration(
            stamp_ns=self._world.now_ns,
            left=left,
            right=right,
            pose_left_right=PoseData.of(Pose.from_translation([rig.baseline_m, 0.0, 0.0])),
            pose_base_camera=PoseData.of(rig.pose_base_camera),
        )

    def capture(self, exposure_scale: float, lamp: int) -> StereoCapture:
        """What is seen as the cell stands; the exposure has gone by on the cell's clock when this is called."""
        exposure_s = self._config.exposure_s * exposure_scale
        if self._scene is None:
            self._scene = self._make()
        self._scene.pose_base_board = self._pose_base_board
        left, right = self._scene.render_stereo(
            self._pose_base_hole,
            self._world.joints_rad,
            self._rng,
            self._faults_under(exposure_scale, lamp),
            self._look if lamp == 0 else self._look.under_another_lamp(lamp),
        )
        return StereoCapture(max(0, self._world.now_ns - round(exposure_s * 1e9)), exposure_s, left, right)

    def _faults_under(self, exposure_scale: float, lamp: int) -> Faults:
        """What is wrong in front of the cameras, as it looks with that exposure and that lamp lit."""
        faults = self._faults
        # a flat plate throws the light of one lamp into the cameras, not that of another
        glare = faults.glare + self._config.glare if lamp == 0 else 0.0
        return replace(
            faults,
            light_scale=faults.light_scale * self._config.brightness * exposure_scale,
            glare=glare * exposure_scale,
        )

    def close(self) -> None:
        """Let the scene go; a second call does nothing."""
        if self._scene is not None:
            self._scene.close()
            self._scene = None
