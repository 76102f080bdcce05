"""The bodies a picture of the cell shows: the fixture with its hole, the arm with its peg, and things in the way."""

from __future__ import annotations

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Hole, Peg
from services.hardware.drivers.simulated.scene.camera_rig import StereoRig
from services.hardware.drivers.simulated.scene.scene_mesh import RenderMesh, box_mesh, capsule_mesh, convex_mesh

ARM_RADII_M = (0.06, 0.05, 0.048, 0.042, 0.034, 0.028)


def arm_meshes(arm: ArmModel, peg: Peg, pose_flange_peg: Pose) -> list[RenderMesh]:
    """One mesh a moving frame: the links in their own frames, then sensor flange and peg, both in the peg frame.

    The arm is drawn as capsules from frame to frame; it shows where the arm is, not the maker's casting.
    """
    meshes = []
    radii = np.interp(np.linspace(0.0, 1.0, arm.joints), np.linspace(0.0, 1.0, len(ARM_RADII_M)), ARM_RADII_M)
    for pose, radius in zip(arm.fixed[1:], radii.tolist(), strict=True):
        # first along the joint's axis, then across, as DH lengths go
        previous, elbow = pose.inverse().apply([[0.0, 0.0, 0.0], [0.0, 0.0, pose.translation_m[2]]])
        parts = [capsule_mesh(previous, elbow, radius), capsule_mesh(elbow, np.zeros(3), radius)]
        meshes.append(RenderMesh.merged(parts))
    flange_m = pose_flange_peg.inverse().translation_m
    back = flange_m * max(0.0, 1.0 - 0.02 / max(float(np.linalg.norm(flange_m)), 0.02))
    front = np.array([0.0, 0.0, peg.body_start_m - 0.02])
    sensor = capsule_mesh(back, front, 0.03)
    return [*meshes, sensor, convex_mesh(peg.pieces())]


def arm_poses(arm: ArmModel, joints_rad: Array, pose_flange_peg: Pose) -> list[Pose]:
    """Where the meshes of `arm_meshes` are in the base frame at joint angles (n,), rad."""
    links = arm.link_poses(joints_rad)[1:]
    pose_base_peg = links[-1] @ pose_flange_peg
    return [*links, pose_base_peg, pose_base_peg]


def obstacle_mesh() -> RenderMesh:
    """A flat piece that hides one arm of the cross, or as much of another hole: in its own frame, centred."""
    return box_mesh((0.016, 0.016, 0.001))


def obstacle_pose(pose_base_hole: Pose, hole: Hole, arm_index: int) -> Pose:
    """The obstacle 15 mm in front of the outer part of one arm of the cross (0..3 for +x, +y, -x, -y)."""
    angle = arm_index * np.pi / 2
    out = hole.outline.reach_m - 0.006
    return pose_base_hole @ Pose.from_rotvec([0.0, 0.0, 0.3], [out * np.cos(angle), out * np.sin(angle), -0.015])


def pocket_mesh() -> RenderMesh:
    """A dark square drawn on the plate's face, beside the cross: in the hole frame."""
    return box_mesh((0.009, 0.009, 0.0001), (0.043, 0.043, 0.0))


def camera_mesh(rig: StereoRig) -> RenderMesh:
    """The two camera bodies, for a picture of the cell from outside: in the left camera's frame."""
    return RenderMesh.merged(
        [
            part
            for x in (0.0, rig.baseline_m)
            for part in (
                box_mesh((0.0145, 0.0145, 0.025), (x, 0.0, -0.03)),
                capsule_mesh(np.array([x, 0.0, -0.008]), np.array([x, 0.0, -0.006]), 0.01),
            )
        ]
        + [box_mesh((0.045, 0.006, 0.03), (rig.baseline_m / 2, 0.0205, -0.03))]
    )
