"""The simulated stereo camera: pictures of the cell as it stands, by a renderer that knows nothing of the physics.

A renderer draws hard, aliased, noise-free facets. Here a picture is drawn as a pinhole sees it at `samples` x `samples`
sub-pixels; the plate gets its finish and shine and what is empty its background there; then it is bent by the lens,
averaged over each pixel as a sensor does, blurred and given noise. Only the window that holds something is drawn; the
rest is the plain background, so the picture is the same as a full one.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift

from crosspih_common.arm import ArmModel, xb4
from crosspih_common.config import CameraSection, Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import CrossPeg, Hole, Peg
from services.hardware.drivers.simulated.scene import camera_bodies as bodies
from services.hardware.drivers.simulated.scene.backdrop import Backdrop
from services.hardware.drivers.simulated.scene.board import PAPER_GREY, ShownBoard
from services.hardware.drivers.simulated.scene.camera_rig import (
    StereoRig,
    lens_matrix,
    look_at_matrix,
    projection_matrix,
    view_matrix,
    window_around,
)
from services.hardware.drivers.simulated.scene.finish import texel_m
from services.hardware.drivers.simulated.scene.fixture_mesh import bottom_mesh, chamfer_meshes, fixture_meshes
from services.hardware.drivers.simulated.scene.lens import Bend, ImageWindow, averaged, plane_to_samples
from services.hardware.drivers.simulated.scene.renderer import Renderer, View, open_renderer
from services.hardware.drivers.simulated.scene.scene_appearance import Appearance, Faults
from services.hardware.drivers.simulated.scene.scene_mesh import RenderMesh, box_mesh
from services.hardware.drivers.simulated.scene.shine import Lit, Plate

GreyImage = NDArray[np.uint8]
FloatImage = NDArray[np.float32]

NEAR_M, FAR_M = 0.02, 4.0
PARKED = Pose.from_translation([-50.0, 0.0, 0.0])
"""Behind both cameras, where a body costs the renderer nothing."""
NO_FAULTS = Faults()
PLATES = (
    ("face", "", Pose.identity()),
    ("blank", "", Pose.identity()),
    ("second_face", "second_", Pose.from_rotvec([0.0, 0.0, np.pi], [0.0, 0.0, 0.0])),
)
"""A face, the prefix of what belongs to it, and how its marks are turned in its plane."""
BLUR_REACH = 4.0


@dataclass(frozen=True, slots=True)
class SensorQuality:
    """How the sensor turns light into pixels: sub-pixels a side, Gaussian lens blur (pixels), noise (grey levels).

    None: as the appearance of the shot says.
    """

    samples: int = 4
    blur_px: float | None = None
    noise_grey: float | None = None


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
        board: ShownBoard | None = None,
    ) -> None:
        self.hole = hole
        self.rig = rig or StereoRig.of(CameraSection())
        self.peg: Peg = peg or CrossPeg()
        self.arm = arm or xb4()
        self.pose_flange_peg = Workcell().pose_flange_peg() if pose_flange_peg is None else pose_flange_peg
        self.quality = quality or SensorQuality()
        self._lenses = self.rig.lens(0), self.rig.lens(1)
        left, right = self.rig.distortions
        bend = Bend(self._lenses[0])
        self._bends = bend, bend if left == right else Bend(self._lenses[1])
        self._renderer = renderer or open_renderer()
        self._bodies: dict[str, _Body] = {}
        chamfers = chamfer_meshes(hole)
        self._ways = [normal for normal, _ in chamfers]
        self._chamfers = [f"chamfer_{index}" for index in range(len(chamfers))]
        fixture = fixture_meshes(hole)
        once = {"blank": fixture.pop("blank")}
        fixture |= zip(self._chamfers, (mesh for _, mesh in chamfers), strict=True)
        fixture["bottom"] = bottom_mesh(hole, 0.0)
        for name, mesh in fixture.items():
            self._add(name, mesh)
            self._add(f"second_{name}", mesh)
        for name, mesh in once.items():
            self._add(name, mesh)
        self._open = ["face", "bore", "sides", *self._chamfers]
        self._add("obstacle", bodies.obstacle_mesh())
        self._add("pocket", bodies.pocket_mesh())
        self._arm_names = []
        for index, mesh in enumerate(bodies.arm_meshes(self.arm, self.peg, self.pose_flange_peg)):
            self._arm_names.append(f"arm_{index}")
            self._add(f"arm_{index}", mesh)
        self._board = board
        self.pose_base_board: Pose | None = None  # None: clamped to the flange
        if board is not None:
            self._add("board", board.mesh())
        self._add("cameras", bodies.camera_mesh(self.rig))
        self._add("floor", box_mesh((0.8, 0.8, 0.01), (0.2, 0.0, -0.01)))
        self._add("stand", box_mesh((0.02, 0.04, 0.1)))
        self._plate: tuple[Appearance, Plate, Backdrop] | None = None

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

        All variation (finish, light, greys, glare, noise) comes from `rng`, or from `appearance` and `rng`: the same
        generator state gives the same bytes.
        """
        look = appearance or Appearance.draw(rng)
        plate, backdrop = self._made(look)
        self._arrange(pose_base_hole, joints_rad, faults, look)
        self._paint(look, faults)
        glare_at = rng.uniform(-1.0, 1.0, 2) * self.hole.outline.reach_m
        glare_base = pose_base_hole.apply([*glare_at, 0.0])
        lit = plate.lit(pose_base_hole, self.rig.poses_base(), look.to_light)
        pictures = []
        for side, rows in enumerate((0.0, faults.right_rows_px)):
            drawn = self._draw(side, look, lit[side], backdrop, faults.light_scale)
            pictures.append(self._expose(_knocked(drawn, rows), side, glare_base, look, faults, rng))
        left, right = pictures
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
        self._arrange(pose_base_hole, joints_rad, NO_FAULTS, None)
        self._place("cameras", self.rig.pose_base_camera)
        self._place("floor", Pose.identity())
        foot = pose_base_hole.apply([-self.hole.plate_half_size_m, 0.0, self.hole.depth_m / 2])
        self._place("stand", Pose(np.eye(3), np.array([foot[0], foot[1], foot[2] - 0.1])))
        colours = dict.fromkeys(("face", "sides", *self._chamfers), (0.82, 0.84, 0.87))
        colours |= {"bore": (0.3, 0.32, 0.35), "floor": (0.66, 0.69, 0.72)}
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

    def _add(self, name: str, mesh: RenderMesh) -> None:
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

    def _made(self, look: Appearance) -> tuple[Plate, Backdrop]:
        """The plate's marks and what is behind it: made once for all pictures of one look."""
        if self._plate is None or self._plate[0] is not look:
            self._plate = look, Plate(self.hole, look, self._ways), Backdrop(self.rig, look)
        return self._plate[1:]

    def _arrange(self, pose_base_hole: Pose, joints_rad: Array | None, faults: Faults, look: Appearance | None) -> None:
        beside = pose_base_hole @ Pose.from_translation([0.0, -2.15 * self.hole.plate_half_size_m, 0.0])
        places = dict.fromkeys(self._bodies, PARKED)
        for name in self._open if faults.hole else ("blank", "sides"):
            places[name] = pose_base_hole
        if faults.second_cross:
            places |= {f"second_{name}": beside for name in self._open}
        if look is not None and look.bottom_share is not None:
            down = Pose.from_translation([0.0, 0.0, look.bottom_share * self.hole.depth_m])
            if faults.hole:
                places["bottom"] = pose_base_hole @ down
            if faults.second_cross:
                places["second_bottom"] = beside @ down
        if faults.square:
            places["pocket"] = pose_base_hole
        if faults.covered_arm is not None:
            places["obstacle"] = bodies.obstacle_pose(pose_base_hole, self.hole, faults.covered_arm)
        if joints_rad is not None:
            places |= zip(self._arm_names, bodies.arm_poses(self.arm, joints_rad, self.pose_flange_peg), strict=True)
            if self._board is not None:
                on_flange = self.arm.pose_base_flange(joints_rad) @ self._board.pose_flange_board
                places["board"] = on_flange if self.pose_base_board is None else self.pose_base_board
        for name, pose in places.items():
            self._place(name, pose)

    def _paint(self, look: Appearance, faults: Faults) -> None:
        greys = dict.fromkeys(self._bodies, 0.6) | {"pocket": 0.1, "obstacle": 0.45}
        if self._board is not None:
            greys["board"] = PAPER_GREY
        fixture = dict.fromkeys(("face", "sides", *self._chamfers), look.face_grey)
        fixture |= {"bore": look.bore_grey, "bottom": look.bottom_grey}
        greys |= fixture | {f"second_{name}": grey for name, grey in fixture.items()} | {"blank": look.face_grey}
        for name, grey in greys.items():
            if self._bodies[name].pose is not PARKED:
                level = min(1.0, grey * faults.light_scale) if faults.light_scale < 1.0 else grey
                self._colour(name, (level, level, level))

    def _draw(self, side: int, look: Appearance, lit: Lit, backdrop: Backdrop, light_scale: float) -> FloatImage:
        """The noise-free picture (height, width), grey levels; background where nothing is."""
        lens, bend, pose_base_camera = self._lenses[side], self._bends[side], self.rig.poses_base()[side]
        pose_camera_base = pose_base_camera.inverse()
        boxes = [(pose_camera_base @ body.pose).apply(body.box_m) for body in self._bodies.values()]
        window = window_around(lens, boxes, NEAR_M, bend.sees)
        dimmed = np.float32(min(1.0, light_scale))
        picture = np.empty((lens.height, lens.width), dtype=np.float32)
        behind = backdrop.in_window(lens, pose_base_camera, bend.sees, 1)
        if isinstance(behind, float):
            picture[:] = dimmed * behind
        else:
            bend.put(dimmed * behind, bend.sees, 1, picture)
        if not window.empty:
            # an even number of sub-pixels is bent at two a pixel: as good, and quick
            samples = self.quality.samples
            fine = 2 if samples % 2 == 0 else samples
            grey, empty = self._draw_window(side, window, look, lit, dimmed)
            behind = backdrop.in_window(lens, pose_base_camera, window, fine)
            if isinstance(behind, float):
                grey[empty] = dimmed * behind
                seen = averaged(grey, samples // fine)
            else:
                seen = averaged(grey, samples // fine)
                seen += averaged(empty.astype(np.float32), samples // fine) * (dimmed * behind)
            bend.put(seen, window, fine, picture)
        return picture

    def _draw_window(
        self, side: int, window: ImageWindow, look: Appearance, lit: Lit, dimmed: np.float32
    ) -> tuple[FloatImage, NDArray[np.bool_]]:
        """Grey levels and where nothing is, at the renderer's sub-pixels; 0 where nothing is."""
        samples, lens, pose_base_camera = self.quality.samples, self._lenses[side], self.rig.poses_base()[side]
        columns, rows = window.right - window.left, window.bottom - window.top
        drawn = self._renderer.draw(
            View(
                columns * samples, rows * samples, view_matrix(pose_base_camera),
                projection_matrix(lens, window, samples, NEAR_M, FAR_M),
                look.to_light, look.ambient, look.diffuse,
            )
        )  # fmt: skip
        grey = drawn.rgb[..., 0].astype(np.float32)
        empty = drawn.empty
        grey[empty] = 0.0
        for face, prefix, turn in PLATES:
            if self._bodies[face].pose is not PARKED:
                self._light_plate(grey, drawn.body, face, prefix, turn, lit, dimmed, window, side)
        if self._board is not None and (here := self._bodies["board"]).pose is not PARKED:
            pose_camera_board = pose_base_camera.inverse() @ here.pose
            self._board.print_on(grey, drawn.body == here.index, lens, pose_camera_board, window, samples)
        return grey, empty

    def _light_plate(
        self, grey: FloatImage, body: NDArray[np.int32], face: str, prefix: str, turn: Pose, lit: Lit,
        dimmed: np.float32, window: ImageWindow, side: int,
    ) -> None:  # fmt: skip
        """Give a plate's face its marks, and its face and chamfer their shine; `turn` turns the marks in its plane."""
        samples, lens = self.quality.samples, self._lenses[side]
        pose_camera_plate = self.rig.poses_base()[side].inverse() @ self._bodies[face].pose
        half = self.hole.plate_half_size_m
        corners = pose_camera_plate.apply(half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float))
        if not np.all(corners[:, 2] > NEAR_M):
            return
        seen = (lens.pinhole(corners) + 0.5 - [window.left, window.top]) * samples
        low = np.maximum(np.floor(seen.min(axis=0)).astype(int) - 1, 0)
        high = np.minimum(np.ceil(seen.max(axis=0)).astype(int) + 2, [grey.shape[1], grey.shape[0]])
        if np.any(high <= low):
            return
        texel = texel_m(half)
        of_texel = np.array([[texel, 0.0, 0.5 * texel - half], [0.0, texel, 0.5 * texel - half], [0.0, 0.0, 1.0]])
        to_part = np.array([[1.0, 0.0, -low[0]], [0.0, 1.0, -low[1]], [0.0, 0.0, 1.0]])
        matrix = to_part @ plane_to_samples(lens, pose_camera_plate @ turn, window, samples) @ of_texel
        marks = cv2.warpPerspective(
            lit.face, matrix, (int(high[0] - low[0]), int(high[1] - low[1])), borderMode=cv2.BORDER_REPLICATE
        )
        part = np.s_[low[1] : high[1], low[0] : high[0]]
        numbers, light = body[part], grey[part]
        on_plate = numbers == self._bodies[face].index
        factor = np.where(on_plate, marks[..., 0], np.float32(1.0))
        for name, gain in zip(self._chamfers, lit.chamfer, strict=True):
            here = numbers == self._bodies[f"{prefix}{name}"].index
            factor[here] = gain
            on_plate |= here
        light *= factor
        light += np.where(on_plate, dimmed * marks[..., 1], np.float32(0.0))

    def _expose(
        self, picture: FloatImage, side: int, glare_at_m: Array, look: Appearance, faults: Faults,
        rng: np.random.Generator,
    ) -> GreyImage:  # fmt: skip
        lens = self._lenses[side]
        rows = np.arange(lens.height, dtype=np.float32)[:, None]
        columns = np.arange(lens.width, dtype=np.float32)[None, :]
        light = _blurred(picture, look.blur_px[side] if self.quality.blur_px is None else self.quality.blur_px)
        across, down = look.gradient
        light *= 1.0 + across * (columns / lens.width - 0.5) + down * (rows / lens.height - 0.5)
        if faults.light_scale > 1.0:
            light *= faults.light_scale
        if faults.glare > 0.0:
            u, v = lens.project(self.rig.poses_base()[side].inverse().apply(glare_at_m))
            light += faults.glare * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2.0 * 9.0**2))
        noise = rng.standard_normal(light.shape, dtype=np.float32)
        noise *= look.noise_grey if self.quality.noise_grey is None else self.quality.noise_grey
        return np.asarray(np.clip(np.rint(light + noise), 0.0, 255.0), dtype=np.uint8)


def _blurred(picture: FloatImage, blur_px: float) -> FloatImage:
    if blur_px <= 0.0:
        return picture.copy()
    side = 2 * int(np.ceil(BLUR_REACH * blur_px)) + 1
    return np.asarray(cv2.GaussianBlur(picture, (side, side), blur_px, borderType=cv2.BORDER_REFLECT), dtype=np.float32)


def _knocked(picture: FloatImage, rows: float) -> FloatImage:
    """The picture of a camera that was tilted by so many rows."""
    if rows == 0.0:
        return picture
    return np.asarray(shift(picture, (rows, 0.0), order=3, mode="nearest"), dtype=np.float32)
