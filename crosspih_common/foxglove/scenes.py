"""The contents of the 3-D view: arm, tool, peg, plate, forces, touches, the estimate.

Each message is complete, so that a viewer which jumps in time needs only the last one of each topic.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from crosspih_common.config import Workcell
from crosspih_common.foxglove.frames import BASE, FLANGE, HOLE, PEG, TRUTH_HOLE, link_frame
from crosspih_common.foxglove.meshes import peg_mesh, plate_mesh
from crosspih_common.foxglove.primitives import (
    Rgba,
    add_arrow,
    add_capsule,
    add_text,
    along,
    at,
    color,
    entity,
    mesh,
    points,
    pose_message,
    scene,
    vector,
)
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import SimulationTruth, Touch

LINK: Rgba = (0.85, 0.87, 0.90, 1.0)
TOOL: Rgba = (0.25, 0.27, 0.30, 1.0)
PEG_COLOR: Rgba = (0.95, 0.62, 0.20, 1.0)
PLATE: Rgba = (0.55, 0.58, 0.62, 1.0)
AROUND: Rgba = (0.50, 0.45, 0.40, 0.6)
FORCE: Rgba = (0.90, 0.15, 0.15, 1.0)
MOMENT: Rgba = (0.55, 0.25, 0.85, 1.0)
TOUCHED: Rgba = (0.95, 0.35, 0.60, 1.0)
BELIEVED: Rgba = (0.20, 0.55, 1.00, 0.35)
BELIEVED_LINE: Rgba = (0.20, 0.55, 1.00, 1.0)
TRUTH: Rgba = (0.20, 0.80, 0.30, 1.0)
M_PER_N, M_PER_NM = 0.004, 0.05  # of arrows
ARROW_M, RIM_M = 0.003, 0.0006
MIN_N, MIN_NM = 0.3, 0.03  # below these no arrow: noise
FAR_M = 0.05  # if the line of action passes the tip's plane farther from the axis, it does not show the contact point
CHI2_95_OF_3 = 7.814728  # of three degrees of freedom: scipy.stats.chi2.ppf(0.95, 3)
MAGNIFIED = 10.0  # the ellipsoid, which is a fraction of a millimetre
MAX_TOUCHES = 100
TRUTH_SOURCE = (("source", "the simulator's truth"),)


class Scenes:
    """The drawings of one cell, and the messages made of them."""

    def __init__(self, workcell: Workcell) -> None:
        self._workcell = workcell
        self._peg = workcell.peg.shape()
        self._hole = workcell.hole.shape(self._peg)
        self._peg_mesh, self._plate_mesh = peg_mesh(self._peg), plate_mesh(self._hole)
        inserted_m = self._hole.chamfer_m + workcell.insertion_depth_m - self._peg.taper_start_m
        seated = self._peg_mesh.corners_m + np.array([0.0, 0.0, inserted_m])
        self._ghost = mesh(seated, self._peg_mesh.triangles, BELIEVED)

    @property
    def rims_m(self) -> list[Array]:
        """The outer and the inner rim (n, 3), in the hole's frame."""
        return [self._hole.outer_rim_m(), self._hole.inner_rim_m()]

    @property
    def tip_m(self) -> float:
        """The tip on the peg's axis, in the peg frame."""
        return self._peg.tip_m

    def arm(self, stamp_ns: int) -> bytes:
        """Links as capsules, the tool as a cylinder, the peg as a mesh, each in its own frame."""
        model = self._workcell.arm()
        made = []
        for index in range(model.joints):
            link = entity(stamp_ns, link_frame(index), f"arm/link_{index + 1}")
            ends = model.fixed[index + 1].apply(model.link_lines_m[index])
            add_capsule(link, ends, float(model.link_radii_m[index]), LINK)
            made.append(link)
        tool = entity(stamp_ns, FLANGE, "arm/tool")
        start = self._workcell.pose_flange_peg().apply([0.0, 0.0, self._peg.body_start_m])
        radius_m = min(self._workcell.surroundings.tool_radius_m, 0.03)
        length = float(np.linalg.norm(start))
        if length > 1e-6:
            tool.cylinders.add(
                pose=along(start, start / 2.0), size=Vector3(x=2 * radius_m, y=2 * radius_m, z=length),
                bottom_scale=1.0, top_scale=0.7, color=color(TOOL),
            )  # fmt: skip
        peg = entity(stamp_ns, PEG, "arm/peg", [("outline", self._peg.outline.name)])
        peg.triangles.append(mesh(self._peg_mesh.corners_m, self._peg_mesh.triangles, PEG_COLOR))
        return scene([*made, tool, peg])

    def plate(self, stamp_ns: int) -> bytes:
        """The plate, in the frame of the estimated hole."""
        plate = entity(stamp_ns, HOLE, "plate")
        plate.triangles.append(mesh(self._plate_mesh.corners_m, self._plate_mesh.triangles, PLATE))
        return scene([plate])

    def surroundings(self, stamp_ns: int) -> bytes | None:
        """Boxes and cylinders of the cell's file; None where it names none."""
        around = self._workcell.surroundings
        made = []
        for box in around.boxes:
            one = entity(stamp_ns, BASE, f"surroundings/{box.name}")
            one.cubes.add(pose=pose_message(box.pose()), size=vector(box.size_m), color=color(AROUND))
            made.append(one)
        for cylinder in around.cylinders:
            one = entity(stamp_ns, BASE, f"surroundings/{cylinder.name}")
            size = Vector3(x=2 * cylinder.radius_m, y=2 * cylinder.radius_m, z=cylinder.length_m)
            one.cylinders.add(
                pose=pose_message(cylinder.pose()), size=size, bottom_scale=1.0, top_scale=1.0, color=color(AROUND)
            )
            made.append(one)
        return scene(made) if made else None

    def force(self, stamp_ns: int, wrench: Sequence[float]) -> bytes:
        """The wrench (6,) on the peg, in the peg frame, as arrows."""
        made = entity(stamp_ns, PEG, "force")
        force, moment = np.asarray(wrench[:3], float), np.asarray(wrench[3:], float)
        if np.linalg.norm(force) >= MIN_N:
            head = line_of_action(force, moment, self._peg.tip_m)
            add_arrow(made, head - M_PER_N * force, head, ARROW_M, FORCE)
        if np.linalg.norm(moment) >= MIN_NM:
            start = np.array([0.0, 0.0, self._peg.body_start_m])
            add_arrow(made, start, start + M_PER_NM * moment, ARROW_M, MOMENT)
        return scene([made])

    def touches(self, stamp_ns: int, touches: Sequence[Touch]) -> bytes:
        """The touch points as arrows that stay, in the base frame, each with its contact state."""
        made = entity(stamp_ns, BASE, "touches")
        for touch in touches[-MAX_TOUCHES:]:
            force, moment = np.asarray(touch.wrench[:3], float), np.asarray(touch.wrench[3:], float)
            pose = touch.pose_base_peg.pose()
            head = line_of_action(force, moment, self._peg.tip_m)
            tail, point = pose.apply(np.stack([head - M_PER_N * force, head]))
            add_arrow(made, tail, point, ARROW_M, TOUCHED)
            add_text(made, f"{touch.index}: {touch.state.case or 'none'}", tail, TOUCHED)
            made.metadata.add(key=f"touch {touch.index}", value=touch.state.case or touch.state.reason)
        return scene([made])

    def estimate(self, stamp_ns: int, covariance: Sequence[float] | None, source: str) -> bytes:
        """The estimated hole: its rim, a ghost of the seated peg, and the uncertainty."""
        ghost = entity(stamp_ns, HOLE, "estimate/peg", [("source", source)])
        ghost.triangles.append(self._ghost)
        sure = entity(stamp_ns, HOLE, "estimate/uncertainty", [("source", source), ("magnified", f"{MAGNIFIED:g}")])
        self._add_rims(sure, BELIEVED_LINE)
        told = f"by {source}"
        if covariance is not None:
            full = np.asarray(covariance, float).reshape(6, 6)
            variances, axes = np.linalg.eigh(full[:3, :3])
            radii = MAGNIFIED * np.sqrt(CHI2_95_OF_3 * np.maximum(variances, 0.0))
            if np.linalg.det(axes) < 0.0:
                axes[:, 0] = -axes[:, 0]
            sure.spheres.add(
                pose=pose_message(Pose(axes, np.zeros(3))), size=vector(2.0 * radii), color=color(BELIEVED)
            )
            sds = np.sqrt(np.maximum(np.diag(full), 0.0))
            for name, value in zip(("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"), sds, strict=True):
                sure.metadata.add(key=f"sd_{name}", value=f"{value:.3g}")
            told += (
                f": sd {1e3 * max(sds[0], sds[1]):.3f} mm across, {1e3 * sds[2]:.3f} along, "
                f"{np.degrees(max(sds[3], sds[4])):.2f}° tilt"
            )
        add_text(sure, told, [0.0, -self._hole.plate_half_size_m, -0.01], BELIEVED_LINE)
        return scene([ghost, sure])

    def true_rim(self, stamp_ns: int) -> bytes:
        """The rim in the frame of the hole as only the simulator knows it."""
        rim = entity(stamp_ns, TRUTH_HOLE, "truth/rim", TRUTH_SOURCE)
        self._add_rims(rim, TRUTH)
        return scene([rim])

    def true_contacts(self, stamp_ns: int, truth: SimulationTruth) -> bytes:
        """Where and how hard the simulator makes peg and plate touch."""
        contacts = entity(stamp_ns, BASE, "truth/contacts", TRUTH_SOURCE)
        for contact in truth.contacts:
            point, force = np.asarray(contact.point_base_m, float), np.asarray(contact.force_base_n, float)
            contacts.spheres.add(pose=at(point), size=vector([0.002] * 3), color=color(TRUTH))
            add_arrow(contacts, point - M_PER_N * force, point, ARROW_M / 2.0, TRUTH)
        return scene([contacts])

    def _add_rims(self, made: SceneEntity, rgba: Rgba) -> None:
        for rim in self.rims_m:
            made.lines.add(
                type=LinePrimitive.LINE_LOOP, pose=at((0.0, 0.0, 0.0)), thickness=RIM_M, points=points(rim),
                color=color(rgba),
            )  # fmt: skip


def line_of_action(force_n: Array, moment_nm: Array, tip_m: float) -> Array:
    """The point where the line of action of a force (3,), with this moment (3,) about the origin, meets the plane
    z = tip; the tip itself if that is farther than FAR_M from the axis."""
    tip = np.array([0.0, 0.0, tip_m])
    square = float(force_n @ force_n)
    if square < MIN_N**2 or abs(force_n[2]) < 1e-3 * np.sqrt(square):
        return tip
    nearest = np.cross(force_n, moment_nm) / square
    meets = nearest + force_n * ((tip_m - nearest[2]) / force_n[2])
    return np.asarray(meets if np.hypot(meets[0], meets[1]) <= FAR_M else tip)
