"""The mechanics against PyBullet's own contact: same direction, travel and moment; and whole assemblies."""

import numpy as np
import pytest

from crosspih_common.geometry import Pose
from crosspih_common.shapes import CrossPeg
from services.inference.mechanics import PairTables, contact_geometry, contact_wrench_basis, first_contacts
from tests.inference.assembly_trial import assemble
from tests.inference.free_peg_world import FreePegWorld, guarded_push

PEG = CrossPeg()
HOLE = PEG.hole(1e-4)


@pytest.mark.parametrize("mu", [0.0, 0.1])
def test_single_contacts_agree(mu: float) -> None:
    """Direction < .05 deg, travel < .02 mm, moment < 1 mNm, at 20 N, once the wrist's deflection is modelled."""
    world = FreePegWorld(PEG, HOLE, mu)
    tables = PairTables.of(PEG, HOLE)
    along = np.array([0.0, 0.0, 1.0])
    rng = np.random.default_rng(0)
    compared = 0
    for _ in range(5):
        rotation = Pose.from_rotvec(rng.uniform(-0.08, 0.08, 3), np.zeros(3)).rotation
        tip = np.array([*rng.uniform(-0.002, 0.002, 2), 0.0])
        record = guarded_push(
            world, Pose(rotation, tip - rotation @ np.array([0.0, 0.0, PEG.tip_m])), along, 0.04, approach_m_s=0.01
        )
        if record.contacts != 1:
            continue
        twist = world.compliance_peg @ record.wrench_peg
        pose = record.commanded_hole_peg @ Pose.from_rotvec(twist[3:], twist[:3])
        assert pose.distance_to_m(record.true_hole_peg) < 1e-5
        pairs = first_contacts(tables, pose.rotation[None], pose.translation_m[None], along[None])
        first = int(pairs.travel_m[0].argmin())
        geometry = contact_geometry(pairs.features[0, first], pose.rotation, pose.translation_m)
        basis = contact_wrench_basis(
            geometry.normal_peg, geometry.point_peg_m, pose.rotation.T @ along, mu, world.compliance_peg
        )
        force = float(record.wrench_peg[:3] @ basis[:3] / (basis[:3] @ basis[:3]))
        sine = np.linalg.norm(np.cross(record.wrench_peg[:3], basis[:3]))
        sine /= np.linalg.norm(record.wrench_peg[:3]) * np.linalg.norm(basis[:3])
        assert np.degrees(np.arcsin(sine)) < 0.05
        assert abs(pairs.travel_m[0, first]) < 2e-5
        assert np.linalg.norm((record.wrench_peg - force * basis)[3:]) < 1e-3
        compared += 1
    world.close()
    assert compared >= 3


def test_assembly_by_touch_and_push() -> None:
    """After vision: two touches, estimate, push; and a push straight away."""
    touched = assemble(PEG, HOLE, 0.1, seed=3, push_first=False)
    assert touched.inserted and touched.corrections == 1
    assert np.linalg.norm(touched.error.translation_m) < 2e-4
    assert np.degrees(np.linalg.norm(touched.error.rotvec_rad())) < 0.5
    pushed = assemble(PEG, HOLE, 0.1, seed=1)
    assert pushed.inserted and pushed.peak_force_n < 30.0
    assert np.linalg.norm(pushed.error.translation_m[:2]) < 1.5e-4
