"""Pegs of other sections in the simulated cell: they slide in, touch where the drawing says, and catch on no seam."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from crosspih_common.config import PegDrawing, Workcell
from crosspih_common.geometry import Pose
from crosspih_common.messages import AdmittanceMove, GuardedMove, ResetCell, StopReason
from crosspih_common.messages.base import PoseData, floats
from services.hardware.config import HardwareConfig
from services.hardware.drivers.simulated.config import SimulatedConfig, SimulatedSensorConfig
from services.hardware.drivers.simulated.engines.arm_bodies import arm_bodies
from services.hardware.drivers.simulated.scene.fixture_mesh import chamfer_meshes, fixture_meshes
from services.hardware.drivers.simulated.scene.scene_mesh import RenderMesh
from services.hardware.hosting import HostedCell, open_cell
from tests.hardware.drivers.simulated.payload import know_payload

FT = SimulatedSensorConfig(noise_n=0.0, noise_nm=0.0)
ELL_M = tuple((x * 1e-3, y * 1e-3) for x, y in ((-24, -6), (4, -6), (4, 22), (-4, 22), (-4, 6), (-24, 6)))


@contextmanager
def opened(peg: PegDrawing, friction: float = 0.1) -> Iterator[tuple[HostedCell, Workcell]]:
    workcell = Workcell(peg=peg)
    config = SimulatedConfig(friction_coefficient=friction, force_torque=FT)
    cell = open_cell(workcell, HardwareConfig(simulated=config), realtime=False)
    try:
        know_payload(cell, FT)
        yield cell, workcell
    finally:
        cell.close()


def place(cell: HostedCell, workcell: Workcell, error: tuple[float, ...], before_m: float) -> Pose:
    """The peg before the nominal hole with an error (x, y, rx, ry, rz); where the hole is."""
    tip_m = workcell.peg.shape().tip_m
    pose = Pose.from_rotvec(error[2:], [*error[:2], -tip_m - before_m])
    cell.simulation.reset(ResetCell(seed=0, offset_hole=(0.0,) * 6, place_peg=PoseData.of(pose)))
    return workcell.hole_prior.pose_base_hole()


@pytest.mark.parametrize(
    "peg",
    [
        PegDrawing(outline="triangle"),
        PegDrawing(outline="star"),
        PegDrawing(outline="keyway"),
        PegDrawing(outline="ell", corners_m=ELL_M),
    ],
    ids=lambda peg: peg.outline,
)
def test_a_peg_slides_in_over_every_seam(peg: PegDrawing) -> None:
    with opened(peg) as (cell, workcell):
        hole = place(cell, workcell, (0.0003, -0.0002, 0.003, -0.003, 0.004), 0.001)
        outcome = cell.arm.admittance_move(
            AdmittanceMove(direction_base=floats(hole.rotation[:, 2]), speed_m_s=0.03, travel_m=0.044, timeout_s=10.0)
        )
        assert outcome.stop_reason is StopReason.SEATED
        assert outcome.peak_force_n < 25.0
        shape = workcell.peg.shape()
        depth_m = (hole.inverse() @ cell.simulation.truth().pose_base_peg.pose()).translation_m[2]
        assert depth_m + shape.taper_start_m - workcell.hole.chamfer_m > workcell.insertion_depth_m


def test_a_triangle_touches_its_wall_where_the_drawing_says() -> None:
    """1 mm towards the side across from the corner on +x: only that side of the taper meets the inner rim."""
    with opened(PegDrawing(outline="triangle"), friction=0.0) as (cell, workcell):
        peg, hole = workcell.peg.shape(), workcell.hole.shape(workcell.peg.shape())
        pose_base_hole = place(cell, workcell, (-0.001, 0.0, 0.0, 0.0, 0.0), 0.002)
        outcome = cell.arm.guarded_move(
            GuardedMove(
                direction_base=floats(pose_base_hole.rotation[:, 2]),
                speed_m_s=0.005,
                travel_limit_m=0.04,
                observe_s=0.1,
            )
        )
        assert outcome.stop_reason is StopReason.CONTACT
        inradius_m = float(np.min(peg.outline.offsets_m))
        slope = inradius_m / (peg.apex_m - peg.taper_start_m)
        z_m = peg.apex_m - (float(np.min(hole.outline.offsets_m)) - 0.001) / slope
        assert outcome.travel_first_contact_m == pytest.approx(hole.chamfer_m - z_m + peg.tip_m + 0.002, abs=2e-5)
        wrench = np.array(cell.simulation.truth().wrench_contact)
        normal = np.array([1.0, 0.0, -slope]) / np.hypot(1.0, slope)
        cosine = wrench[:3] @ normal / np.linalg.norm(wrench[:3])
        assert np.degrees(np.arccos(min(1.0, cosine))) < 0.3


def test_any_number_of_pieces_weighs_and_rubs_the_same() -> None:
    pybullet = pytest.importorskip("pybullet")
    from services.hardware.drivers.simulated.engines.pybullet import bodies

    for name in ("square", "star", "cross"):
        workcell = Workcell(peg=PegDrawing(outline=name))
        client = int(pybullet.connect(pybullet.DIRECT))
        try:
            pieces = bodies.corners(workcell.peg.shape().pieces())
            arm = arm_bodies(workcell, SimulatedConfig(force_torque=FT))
            body = bodies.add_arm(arm, pieces, client)
            bodies.set_peg_friction(body, 6, 0.17, client)
            links = bodies.piece_links(body, 6, client)
            assert len(links) == len(pieces)
            got = [pybullet.getDynamicsInfo(body, link, physicsClientId=client) for link in (6, *links)]
            assert sum(info[0] for info in got) == pytest.approx(FT.payload_kg, abs=1e-12)
            assert all(info[1] == pytest.approx(0.17) for info in got[1:])
        finally:
            pybullet.disconnect(client)


@pytest.mark.parametrize("name", ["cross", "star", "round"])
def test_the_plate_that_is_seen_is_the_plate_that_is_felt(name: str) -> None:
    hole = Workcell(peg=PegDrawing(outline=name)).hole.shape(PegDrawing(outline=name).shape())
    meshes = fixture_meshes(hole)
    chamfer = [mesh for _, mesh in chamfer_meshes(hole)]
    seen = RenderMesh.merged([meshes["face"], meshes["sides"], meshes["bore"], *chamfer])
    corners = seen.vertices_m[np.array(seen.indices).reshape(-1, 3)]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # closed, turned outward, and around as much as is solid
    np.testing.assert_allclose(np.sum(doubled, axis=0), 0.0, atol=1e-12)
    assert np.all(np.sum(doubled * seen.normals[seen.indices[::3]], axis=1) > 0.0)
    volume_m3 = float(np.sum(corners[:, 0] * doubled)) / 6.0
    frustum = [hole.outline.grown(back).area_m2 for back in (0.0, hole.chamfer_m / 2.0, hole.chamfer_m)]
    opening_m3 = (frustum[0] + 4.0 * frustum[1] + frustum[2]) / 6.0 * hole.chamfer_m
    opening_m3 += frustum[0] * (hole.depth_m - hole.chamfer_m)
    assert volume_m3 == pytest.approx((2.0 * hole.plate_half_size_m) ** 2 * hole.depth_m - opening_m3, rel=1e-9)
