"""A cell in the page's 3-D view: fixed bodies are drawn once, moving ones follow a moment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import CameraCalibration, CameraModel
from services.viewer.bodies import Body, bodies_of, cameras_of, frames_of, seated_peg, upwards
from services.viewer.contact_point import contact_point
from services.viewer.solids import ellipsoid, peg_mesh
from services.viewer.timeline import HoleBelieved, SceneMoment

if TYPE_CHECKING:
    import viser

STILL_M = 2e-5
TOUCHED_M = 0.0022
SAMPLES = 14  # number of rims drawn from the covariance
N_TO_M = 0.008  # length of a force arrow
LONGEST_M = 0.16
SIGMAS = 2.8  # 95 % of a Gaussian in three dimensions lie inside
LARGER = 10.0  # by what factor the uncertainty is drawn enlarged
FRUSTUM_M = 0.06
FORCE, TOUCHED, DOUBT, GHOST = (34, 139, 230), (250, 176, 5), (190, 75, 219), (64, 192, 87)


def wxyz(pose: Pose) -> Array:
    """The quaternion (4,) of a pose in viser's order."""
    return np.roll(pose.quaternion_xyzw(), 1)


class CellView:
    """One cell below the scene node `root`, `offset_m` (3,) away from the scene's origin."""

    def __init__(self, server: viser.ViserServer, workcell: Workcell, root: str, offset_m: Array) -> None:
        self._scene, self._workcell, self._root = server.scene, workcell, root
        self._peg = workcell.peg.shape()
        self._hole = workcell.hole.shape(self._peg)
        self._scene.add_frame(root, show_axes=False, position=offset_m)
        self._frames: dict[str, Any] = {}
        self._shown: dict[str, Pose] = {}
        home = frames_of(workcell, np.asarray(workcell.home_joints_rad))
        home["hole"] = workcell.hole_prior.pose_base_hole()
        for name, pose in home.items():
            node = self._scene.add_frame(
                self._node(name), show_axes=False, position=pose.translation_m, wxyz=wxyz(pose)
            )
            self._frames[name], self._shown[name] = node, pose
        self._solids = {body.name: self._draw(body) for body in bodies_of(workcell)}
        self._floor()
        self._camera: CameraCalibration | None = None
        self._frusta: dict[str, Any] = {}
        self._cameras(None)
        self._belief: HoleBelieved | None = None
        self._touches = (-1, -1)
        self._force = self._scene.add_arrows(
            f"{root}/force", np.zeros((1, 2, 3), np.float32), FORCE, shaft_radius=0.0022, head_radius=0.006,
            head_length=0.014, visible=False,
        )  # fmt: skip

    def _node(self, name: str) -> str:
        return f"{self._root}/{name}"

    def _draw(self, body: Body) -> Any:
        parent = self._root if body.frame == "base" else self._node(body.frame)
        return self._scene.add_mesh_simple(
            f"{parent}/{body.name}", body.mesh.corners_m.astype(np.float32), body.mesh.faces,
            color=body.colour, flat_shading=body.sharp, opacity=None if body.opacity >= 1.0 else body.opacity,
            side="double" if body.opacity < 1.0 else "front", cast_shadow=body.opacity >= 1.0,
        )  # fmt: skip

    def _floor(self) -> None:
        floor_m = self._workcell.surroundings.floor_height_m
        up = upwards(self._workcell)
        turn = _turned_to(up)
        self._scene.add_grid(
            f"{self._root}/floor", 2.4, 2.4, cell_size=0.1, section_size=0.5, cell_color=(150, 158, 170),
            section_color=(110, 120, 135), cell_thickness=0.6, section_thickness=1.0, shadow_opacity=0.28,
            plane_color=(128, 136, 148), plane_opacity=0.10, fade_distance=6.0, fade_from="origin",
            position=up * (floor_m or 0.0), wxyz=wxyz(turn),
        )  # fmt: skip

    # ------------------------------------------------------------------------------------------------------- showing

    def show(self, moment: SceneMoment) -> None:
        """Move everything to where it was at that moment."""
        frames: dict[str, Pose] = {}
        if moment.joints_rad is not None:
            frames = frames_of(self._workcell, moment.joints_rad)
        belief = moment.belief
        frames["hole"] = self._workcell.hole_prior.pose_base_hole() if belief is None else belief.pose_base_hole.pose()
        for name, pose in frames.items():
            self._place(name, pose)
        if moment.camera is not self._camera:
            self._cameras(moment.camera)
        if belief != self._belief:
            self._believe(belief)
        self._show_touches(moment)
        self._show_force(moment, frames.get("peg"))

    def see_through(self, clear: bool) -> None:
        """Show peg and plate as glass, or as they are: glass shows what touches inside."""
        for name, opacity in (("platform/plate", 0.3), ("peg", 0.55)):
            self._solids[name].opacity = opacity if clear else None

    def picture(self, camera: str, pixels: Array | None) -> None:
        """Show a picture, (height, width, 3) uint8, in the frustum of the camera that took it."""
        self._frusta[camera].image = pixels

    def _place(self, name: str, pose: Pose) -> None:
        shown = self._shown[name]
        if shown.distance_to_m(pose) < STILL_M and np.abs(shown.rotation - pose.rotation).max() < 2e-4:
            return
        self._frames[name].position, self._frames[name].wxyz = pose.translation_m, wxyz(pose)
        self._shown[name] = pose

    def _cameras(self, told: CameraCalibration | None) -> None:
        self._camera = told
        for name, model, pose in cameras_of(self._workcell, told):
            self._frusta[name] = self._scene.add_camera_frustum(
                f"{self._root}/camera {name}", fov=_fov_rad(model), aspect=model.width_px / model.height_px,
                scale=FRUSTUM_M, thickness=0.0007, color=(32, 98, 160), position=pose.translation_m, wxyz=wxyz(pose),
                cast_shadow=False,
            )  # fmt: skip

    def _believe(self, belief: HoleBelieved | None) -> None:
        """Draw a ghost of the peg as if seated, and the uncertainty of the hole, much enlarged."""
        self._belief = belief
        for name in ("ghost", "doubt", "rims"):
            self._scene.remove_by_name(self._node(name))
        if belief is None:
            return
        hole = belief.pose_base_hole.pose()
        peg, seat = peg_mesh(self._peg), seated_peg(self._workcell, hole)
        self._scene.add_mesh_simple(
            self._node("ghost"), peg.corners_m.astype(np.float32), peg.faces, color=GHOST, opacity=0.28,
            flat_shading=True, side="double", cast_shadow=False, receive_shadow=False, position=seat.translation_m,
            wxyz=wxyz(seat),
        )  # fmt: skip
        if belief.covariance is None:
            return
        doubt = ellipsoid(np.asarray(belief.covariance).reshape(6, 6)[:3, :3], SIGMAS * LARGER)
        self._scene.add_line_segments(
            self._node("rims"), self._rims(np.asarray(belief.covariance).reshape(6, 6)), DOUBT, thickness=0.0004,
            thickness_units="world", position=hole.translation_m, wxyz=wxyz(hole),
        )  # fmt: skip
        self._scene.add_mesh_simple(
            self._node("doubt"), doubt.corners_m.astype(np.float32), doubt.faces, color=DOUBT, opacity=0.4,
            cast_shadow=False, receive_shadow=False, position=hole.translation_m, wxyz=wxyz(hole),
        )  # fmt: skip

    def _rims(self, covariance: Array) -> Array:
        """Possible rims (k, 2, 3) of the hole: samples of the covariance (6, 6), enlarged by the same factor as the
        ellipsoid.
        """
        corners = self._hole.outer_rim_m()
        values, axes = np.linalg.eigh(covariance)
        drawn = np.random.default_rng(0).standard_normal((SAMPLES, 6))
        moved = LARGER * (drawn * np.sqrt(np.maximum(values, 0.0))) @ axes.T
        lines = []
        for shift in moved:
            ring = Pose.from_rotvec(shift[3:], shift[:3]).apply(corners)
            lines.append(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))
        return np.concatenate(lines).astype(np.float32)

    def _show_touches(self, moment: SceneMoment) -> None:
        now = (moment.trial_ns, len(moment.touches))
        if now == self._touches:
            return
        self._touches = now
        self._scene.remove_by_name(self._node("touches"))
        self._scene.remove_by_name(self._node("touch forces"))
        points, arrows = [], []
        for touch in moment.touches:
            pose, wrench = touch.pose_base_peg.pose(), np.asarray(touch.wrench)
            if (point := contact_point(wrench, self._peg)) is not None:
                points.append(pose.apply(point))
                arrows.append(_arrow(points[-1], pose.rotate(wrench[:3])))
        if points:
            self._scene.add_frame(self._node("touches"), show_axes=False)
            for index, point in enumerate(points):
                self._scene.add_icosphere(
                    self._node(f"touches/{index}"),
                    TOUCHED_M,
                    TOUCHED,
                    subdivisions=2,
                    position=point,
                    cast_shadow=False,
                )
            self._scene.add_arrows(
                self._node("touch forces"), np.array(arrows, np.float32), TOUCHED, shaft_radius=0.0011,
                head_radius=0.0032, head_length=0.008,
            )  # fmt: skip

    def _show_force(self, moment: SceneMoment, pose_base_peg: Pose | None) -> None:
        point = None
        if moment.wrench is not None and moment.in_contact and pose_base_peg is not None:
            point = contact_point(moment.wrench, self._peg)
        if point is None or pose_base_peg is None or moment.wrench is None:
            if self._force.visible:
                self._force.visible = False
            return
        arrow = _arrow(pose_base_peg.apply(point), pose_base_peg.rotate(moment.wrench[:3]))
        self._force.points = np.array([arrow], np.float32)
        if not self._force.visible:
            self._force.visible = True


def _arrow(point_m: Array, force_n: Array) -> Array:
    """An arrow (2, 3) that presses on a point: its tip is there."""
    size = float(np.linalg.norm(force_n))
    length = 0.02 + min(size * N_TO_M, LONGEST_M)
    return np.array([point_m - force_n / size * length, point_m])


def _turned_to(up: Array) -> Pose:
    """A frame whose z is `up`."""
    aside = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    aside /= np.linalg.norm(aside)
    return Pose(np.column_stack([aside, np.cross(up, aside), up]), np.zeros(3))


def _fov_rad(model: CameraModel) -> float:
    """The vertical field of view."""
    return 2.0 * float(np.arctan2(model.height_px / 2, model.fy_px))
