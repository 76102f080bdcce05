"""Meshes are closed, face outwards, and hold the volume that the drawing has."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.config.drawing import PegDrawing
from services.viewer.bodies import bodies_of, frames_of, seated_peg
from services.viewer.solids import SolidMesh, box, capsule, cylinder, ellipsoid, peg_mesh, plate_mesh

ROUND = 0.03  # a circle of 28 corners has so much less area, and a ball less volume


def volume_m3(mesh: SolidMesh) -> float:
    """By the divergence theorem: right only where the mesh is closed and faces outwards."""
    a, b, c = (mesh.corners_m[mesh.faces[:, index]] for index in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def is_closed(mesh: SolidMesh) -> bool:
    """Every edge is passed as often one way as the other."""
    _, which = np.unique(np.round(mesh.corners_m, 7), axis=0, return_inverse=True)
    edges: Counter[tuple[int, int]] = Counter()
    for face in which.reshape(-1)[mesh.faces]:
        for start, end in zip(face, np.roll(face, -1), strict=True):
            if start != end:
                edges[int(start), int(end)] += 1
    return all(count == edges[end, start] for (start, end), count in edges.items())


@pytest.mark.parametrize("name", ["cross", "star", "round", "keyway"])
def test_peg_and_plate_have_the_volume_of_their_drawings(name: str) -> None:
    workcell = Workcell(peg=PegDrawing(outline=name))
    peg = workcell.peg.shape()
    hole = workcell.hole.shape(peg)
    body = peg.outline.area_m2 * (peg.taper_start_m - peg.body_start_m)
    tip = float(peg.scale_at(peg.tip_m))
    taper = peg.outline.area_m2 * peg.taper_length_m * (1.0 + tip + tip**2) / 3.0  # a frustum
    assert is_closed(peg_mesh(peg))
    assert volume_m3(peg_mesh(peg)) == pytest.approx(body + taper, rel=1e-6)
    plate = plate_mesh(hole)
    most = (2.0 * hole.plate_half_size_m) ** 2 * hole.depth_m
    least = most - hole.opening().area_m2 * hole.depth_m
    assert is_closed(plate)
    assert least < volume_m3(plate) < most - hole.outline.area_m2 * hole.depth_m


def test_simple_solids_have_the_volumes_of_their_formulas() -> None:
    assert volume_m3(box([0.1, 0.2, 0.3])) == pytest.approx(0.006)
    rod = cylinder([0.1, 0.0, 0.0], [0.1, 0.4, 0.0], 0.05)
    assert volume_m3(rod) == pytest.approx(np.pi * 0.05**2 * 0.4, rel=ROUND)
    pill = capsule([0.0, 0.0, 0.1], [0.0, 0.0, 0.4], 0.05)
    assert volume_m3(pill) == pytest.approx(np.pi * 0.05**2 * 0.3 + 4 / 3 * np.pi * 0.05**3, rel=ROUND)
    ball = ellipsoid(np.diag([1e-4, 4e-4, 9e-4]), 2.0)
    assert volume_m3(ball) == pytest.approx(4 / 3 * np.pi * 8.0 * 0.01 * 0.02 * 0.03, rel=2 * ROUND)
    assert np.abs(ball.corners_m).max(axis=0) == pytest.approx([0.02, 0.04, 0.06], rel=0.02)
    assert all(is_closed(one) for one in (rod, pill, ball))


def test_every_body_hangs_on_a_frame_that_there_is_and_the_peg_where_the_arm_holds_it() -> None:
    workcell = Workcell()
    home = np.asarray(workcell.home_joints_rad)
    frames = {"base", "hole", *frames_of(workcell, home)}
    bodies = bodies_of(workcell)
    assert {body.frame for body in bodies} <= frames
    assert len({body.name for body in bodies}) == len(bodies)
    pose = frames_of(workcell, home)["peg"]
    assert pose.matrix() == pytest.approx(workcell.pose_base_peg(home).matrix())


def test_a_seated_peg_is_in_by_what_counts_as_inserted() -> None:
    workcell = Workcell()
    hole = workcell.hole_prior.pose_base_hole()
    peg = workcell.peg.shape()
    body_end = seated_peg(workcell, hole).apply([0.0, 0.0, peg.taper_start_m])
    depth = hole.inverse().apply(body_end)[2] - workcell.hole.shape(peg).chamfer_m
    assert depth == pytest.approx(workcell.insertion_depth_m)
