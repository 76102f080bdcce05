"""Pictures through other lenses: the simulated cameras' own, larger and sharp, seen again by cameras of any kind.

Both cameras keep their place; what turns is the camera about its own centre, so that one picture is the other's.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from crosspih_common.config import CameraSection, Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import CameraCalibration, CameraModel, PoseData
from services.hardware.drivers.simulated.scene.camera import SensorQuality, SimulatedScene
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.vision.stereo import Camera
from tests.vision.pictures.plain_look import plain_look

FINE = 2  # pixels of the sharp picture a pixel of the other
OWN = CameraSection()


def fine_pair(truth: Pose, seed: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The cell's pair at `FINE` times its size, without noise, float32."""
    workcell = Workcell()
    section = OWN.model_copy(
        update={
            "width_px": FINE * OWN.width_px, "height_px": FINE * OWN.height_px,
            "fx_px": FINE * OWN.fx_px, "fy_px": FINE * OWN.fy_px,
            "cx_px": FINE * (OWN.cx_px + 0.5) - 0.5, "cy_px": FINE * (OWN.cy_px + 0.5) - 0.5,
        }
    )  # fmt: skip
    quality = SensorQuality(samples=2, blur_px=0.7 * FINE, noise_grey=0.0)
    with SimulatedScene(workcell.hole.shape(workcell.peg.shape()), StereoRig.of(section), quality=quality) as scene:
        rng = np.random.default_rng(seed)
        left, right = scene.render_stereo(truth, None, rng, appearance=plain_look(rng))
    return left.astype(np.float32), right.astype(np.float32)


def seen_by(fine: NDArray[np.float32], told: CameraModel, turn: Pose) -> NDArray[np.float32]:
    """What a camera sees that stands where the fine picture was taken, turned by `turn`; NaN-free, 0 outside."""
    camera = Camera.of(told)
    rows, columns = np.mgrid[0 : told.height_px, 0 : told.width_px]
    slopes = camera.slopes(np.stack([columns, rows], axis=-1).astype(float))
    rays = np.concatenate([slopes, np.ones((*slopes.shape[:-1], 1))], axis=-1) @ turn.rotation.T
    u = FINE * (OWN.fx_px * rays[..., 0] / rays[..., 2] + OWN.cx_px + 0.5) - 0.5
    v = FINE * (OWN.fy_px * rays[..., 1] / rays[..., 2] + OWN.cy_px + 0.5) - 0.5
    where = np.nan_to_num(np.stack([u, v]), nan=-1e4).astype(np.float32)
    return np.asarray(cv2.remap(fine, where[0], where[1], cv2.INTER_CUBIC), dtype=np.float32)


def calibration_of(left: CameraModel, right: CameraModel, turn_left: Pose, turn_right: Pose) -> CameraCalibration:
    """The message of two cameras in the places of the cell's own, each turned in its own frame."""
    beside = Pose.from_translation([OWN.baseline_m, 0.0, 0.0])
    return CameraCalibration(
        left=left,
        right=right,
        pose_left_right=PoseData.of(turn_left.inverse() @ beside @ turn_right),
        pose_base_camera=PoseData.of(OWN.pose_base_camera() @ turn_left),
    )
