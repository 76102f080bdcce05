"""The simulated stereo camera: pictures of the cell as it stands, by a renderer that knows nothing of the physics.

A renderer draws hard, aliased, noise-free facets. Here a picture is drawn at `samples` x `samples` sub-pixels,
averaged over each pixel as a sensor does, blurred by the lens and given noise. Only the window that holds something is
drawn; the rest is the plain background, so the picture is the same as a full one.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, shift

from crosspih_common.arm import ArmModel, xb4
from crosspih_common.config import CameraSection, Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import CrossPeg, Hole, Peg
from services.hardware.drivers.simulated.scene import camera_bodies as bodies
from services.hardware.drivers.simulated.scene.camera_rig import (
    StereoRig,
    Window,
    lens_matrix,
    look_at_matrix,
    projection_matrix,
    view_matrix,
    window_around,
)
from services.hardware.drivers.simulated.scene.fixture_mesh import fixture_meshes
from services.hardware.drivers.simulated.scene.renderer import Renderer, View, open_renderer
from services.hardware.drivers.simulated.scene.scene_appearance import Appearance, Faults
from services.hardware.drivers.simulated.scene.scene_mesh import Mesh, box_mesh

GreyImage = NDArray[np.uint8]
FloatImage = NDArray[np.float32]

NEAR_M, FAR_M = 0.02, 4.0
PARKED = Pose.from_translation([-50.0, 0.0, 0.0])
"""Behind both cameras, where a body costs the renderer nothing."""
NO_FAULTS = Faults()


@dataclass(frozen=True, slots=True)
class SensorQuality:
    """How the sensor turns light into pixels: sub-pixels a side, Gaussian lens blur (pixels), noise (grey levels)."""

    samples: int = 4
    blur_px: float = 0.7
    noise_grey: float = 3.0


@dataclass(slots=True)
class _Body:
    index: int
    box_m: Array
    pose: Pose


class SimulatedScene:
    """Everything the cameras can see, drawn by the renderer that is given, or the fastest that is installed.

    A scene is one thread's. Use it as a context manager, or call `close`, which closes the renderer too.
    """

    def __init__(
        self,
        hole: Hole,
        rig: StereoRig | None = None,
        peg: Peg | None = None,
        arm: ArmModel | None = None,
        quality: SensorQuality | None = None,
        pose_flange_peg: Pose | None = None,
        renderer: Renderer | None = None,
    ) -> None:
        self.hole = hole
        self.rig = rig or StereoRig.of(CameraSection())
        self.peg: Peg = peg or CrossPeg()
        self.arm = arm or xb4()
        self.pose_flange_peg = Workcell().pose_flange_peg() if pose_flange_peg is None else pose_flange_peg
        self.quality = quality or SensorQuality()
        self._renderer = renderer or open_renderer()
        self._bodies: dict[str, _Body] = {}
        for name, mesh in fixture_meshes(hole).items():
            self._add(name, mesh)
            if name != "blank":
                self._add(f"second_{name}", mesh)
        self._add("obstacle", bodies.obstacle_mesh())
        self._add("pocket", bodies.pocket_mesh())
        self._arm_names = []
        for index, mesh in enumerate(bodies.arm_meshes(self.arm, self.peg, self.pose_flange_peg)):
            self._arm_names.append(f"arm_{index}")
            self._add(f"arm_{index}", mesh)
        self._add("cameras", bodies.camera_mesh(self.rig))
        self._add("floor", box_mesh((0.8, 0.8, 0.01), (0.2, 0.0, -0.01)))
        self._add("stand", box_mesh((0.02, 0.04, 0.1)))

    def close(self) -> None:
        """Give the renderer back; a second call does nothing."""
        self._renderer.close()

    def __enter__(self) -> SimulatedScene:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def render_stereo(
        self,
        pose_base_hole: Pose,
        joints_rad: Array | None,
        rng: np.random.Generator,
        faults: Faults = NO_FAULTS,
        appearance: Appearance | None = None,
    ) -> tuple[GreyImage, GreyImage]:
        """Left and right grey pictures (height, width) of the hole at a pose, with the arm at joints (n,) if given.

        All variation (light, greys, glare, noise) comes from `rng`: the same generator state gives the same bytes.
        """
        look = appearance or Appearance.draw(rng)
        self._arrange(pose_base_hole, joints_rad, faults)
        self._paint(look, faults)
        glare_at = rng.uniform(-1.0, 1.0, 2) * self.hole.outline.reach_m
        glare_base = pose_base_hole.apply([*glare_at, 0.0])
        left, right = (
            self._expose(_knocked(self._draw(at, look, faults.light_scale), rows), at, glare_base, look, faults, rng)
            for at, rows in ((self.rig.pose_base_camera, 0.0), (self.rig.pose_base_right(), faults.right_rows_px))
        )
        return (right, left) if faults.swapped else (left, right)

    def render_overview(
        self,
        pose_base_hole: Pose,
        joints_rad: Array,
        eye_m: tuple[float, float, float] = (0.75, -0.95, 0.75),
        target_m: tuple[float, float, float] = (0.2, -0.12, 0.22),
        width: int = 960,
        height: int = 720,
    ) -> NDArray[np.uint8]:
        """A picture (height, width, 3) RGB of the whole cell from any point, for people."""
        self._arrange(pose_base_hole, joints_rad, NO_FAULTS)
        self._place("cameras", self.rig.pose_base_camera)
        self._place("floor", Pose.identity())
        foot = pose_base_hole.apply([-self.hole.plate_half_size_m, 0.0, self.hole.depth_m / 2])
        self._place("stand", Pose(np.eye(3), np.array([foot[0], foot[1], foot[2] - 0.1])))
        colours = {"face": (0.82, 0.84, 0.87), "bore": (0.3, 0.32, 0.35), "floor": (0.66, 0.69, 0.72)}
        colours |= {"stand": (0.35, 0.37, 0.4), "cameras": (0.12, 0.13, 0.15)}
        colours |= {name: (0.93, 0.93, 0.94) for name in self._arm_names}
        colours |= {self._arm_names[-2]: (0.25, 0.27, 0.3), self._arm_names[-1]: (0.95, 0.5, 0.1)}
        for name, colour in colours.items():
            self._colour(name, colour)
        drawn = self._renderer.draw(
            View(
                2 * width, 2 * height, look_at_matrix(eye_m, target_m), lens_matrix(45.0, width / height, 0.05, 5.0),
                np.array([0.6, -1.0, 1.6]), ambient=0.55, diffuse=0.45, specular=0.05, shadow=True,
            )
        )  # fmt: skip
        picture = drawn.rgb.astype(float)
        picture[drawn.empty] = (236.0, 240.0, 244.0)
        return np.asarray(picture.reshape(height, 2, width, 2, 3).mean(axis=(1, 3)).round(), dtype=np.uint8)

    def _add(self, name: str, mesh: Mesh) -> None:
        index = self._renderer.add(mesh)
        self._renderer.place(index, PARKED)
        self._bodies[name] = _Body(index, mesh.corners_m(), PARKED)

    def _place(self, name: str, pose: Pose) -> None:
        body = self._bodies[name]
        if body.pose is PARKED and pose is PARKED:
            return
        body.pose = pose
        self._renderer.place(body.index, pose)

    def _colour(self, name: str, rgb: tuple[float, float, float]) -> None:
        self._renderer.colour(self._bodies[name].index, rgb)

    def _arrange(self, pose_base_hole: Pose, joints_rad: Array | None, faults: Faults) -> None:
        beside = pose_base_hole @ Pose.from_translation([0.0, -2.15 * self.hole.plate_half_size_m, 0.0])
        places = dict.fromkeys(self._bodies, PARKED)
        for name in ("face", "bore") if faults.hole else ("blank",):
            places[name] = pose_base_hole
        if faults.second_cross:
            places |= {"second_face": beside, "second_bore": beside}
        if faults.square:
            places["pocket"] = pose_base_hole
        if faults.covered_arm is not None:
            places["obstacle"] = bodies.obstacle_pose(pose_base_hole, self.hole, faults.covered_arm)
        if joints_rad is not None:
            places |= zip(self._arm_names, bodies.arm_poses(self.arm, joints_rad, self.pose_flange_peg), strict=True)
        for name, pose in places.items():
            self._place(name, pose)

    def _paint(self, look: Appearance, faults: Faults) -> None:
        face, bore = look.face_grey, look.bore_grey
        greys = dict.fromkeys(self._bodies, 0.6) | {"face": face, "blank": face, "second_face": face}
        greys |= {"bore": bore, "second_bore": bore, "pocket": 0.1, "obstacle": 0.45}
        for name, grey in greys.items():
            if self._bodies[name].pose is not PARKED:
                level = min(1.0, grey * faults.light_scale) if faults.light_scale < 1.0 else grey
                self._colour(name, (level, level, level))

    def _draw(self, pose_base_camera: Pose, look: Appearance, light_scale: float) -> FloatImage:
        """The noise-free picture (height, width), grey levels; background where nothing is."""
        pose_camera_base = pose_base_camera.inverse()
        boxes = [(pose_camera_base @ body.pose).apply(body.box_m) for body in self._bodies.values()]
        window = window_around(self.rig, boxes, NEAR_M)
        background = 255.0 * look.background_grey * min(1.0, light_scale)
        picture = np.full((self.rig.height, self.rig.width), background, dtype=np.float32)
        if not window.empty:
            picture[window.top : window.bottom, window.left : window.right] = self._draw_window(
                pose_base_camera, window, look, background
            )
        return picture

    def _draw_window(self, pose_base_camera: Pose, window: Window, look: Appearance, background: float) -> FloatImage:
        samples = self.quality.samples
        columns, rows = window.right - window.left, window.bottom - window.top
        drawn = self._renderer.draw(
            View(
                columns * samples, rows * samples, view_matrix(pose_base_camera),
                projection_matrix(self.rig, window, samples, NEAR_M, FAR_M),
                look.to_light, look.ambient, look.diffuse,
            )
        )  # fmt: skip
        grey = drawn.rgb[..., 0].astype(np.float32)
        grey[drawn.empty] = background
        blocks = grey.reshape(rows, samples, columns, samples)
        return np.asarray(blocks.sum(axis=3).sum(axis=1) / np.float32(samples * samples), dtype=np.float32)

    def _expose(
        self, picture: FloatImage, pose_base_camera: Pose, glare_at_m: Array, look: Appearance, faults: Faults,
        rng: np.random.Generator,
    ) -> GreyImage:  # fmt: skip
        rows = np.arange(self.rig.height, dtype=np.float32)[:, None]
        columns = np.arange(self.rig.width, dtype=np.float32)[None, :]
        light = np.asarray(gaussian_filter(picture, self.quality.blur_px, truncate=4.0), dtype=np.float32)
        across, down = look.gradient
        light *= 1.0 + across * (columns / self.rig.width - 0.5) + down * (rows / self.rig.height - 0.5)
        if faults.light_scale > 1.0:
            light *= faults.light_scale
        if faults.glare > 0.0:
            u, v = self.rig.project(pose_base_camera.inverse().apply(glare_at_m))
            light += faults.glare * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2.0 * 9.0**2))
        noise = rng.standard_normal(light.shape, dtype=np.float32)
        noise *= self.quality.noise_grey
        return np.asarray(np.clip(np.rint(light + noise), 0.0, 255.0), dtype=np.uint8)


def _knocked(picture: FloatImage, rows: float) -> FloatImage:
    """The picture of a camera that was tilted by so many rows."""
    if rows == 0.0:
        return picture
    return np.asarray(shift(picture, (rows, 0.0), order=3, mode="nearest"), dtype=np.float32)
