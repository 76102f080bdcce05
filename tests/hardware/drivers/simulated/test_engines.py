"""The physics engines: what each must do alone, how they agree with each other, and how one is chosen."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from crosspih_common.arm.inverse import nearest
from crosspih_common.config import Workcell, load_cell
from crosspih_common.errors import ConfigError
from crosspih_common.geometry import Pose, wrench_of_force_at_point
from crosspih_common.geometry.pose import Array
from services.hardware.drivers.simulated.config import SimulatedConfig, SimulatedSensorConfig, TruthConfig
from services.hardware.drivers.simulated.engines import registry
from services.hardware.drivers.simulated.engines.arm_bodies import arm_bodies, joint_lines, link_masses
from services.hardware.drivers.simulated.engines.protocol import Physics
from services.hardware.drivers.simulated.engines.registry import (
    AUTO,
    ENGINES,
    chosen_engine,
    installed_engines,
    open_engine,
)

CELLS = Path(__file__).resolve().parents[4] / "deploy" / "cells"
WORKCELL = Workcell()
HOLE = WORKCELL.hole_prior.pose_base_hole()
TIP_M = WORKCELL.peg.shape().tip_m
FT = SimulatedSensorConfig()
EVERY = pytest.mark.parametrize("name", installed_engines())


@contextmanager
def opened(name: str, config: SimulatedConfig | None = None) -> Iterator[Physics]:
    engine = open_engine(name, WORKCELL, config or SimulatedConfig())
    try:
        yield engine
    finally:
        engine.close()


def joints_at(pose_hole_peg: Pose) -> Array:
    return nearest(
        WORKCELL.arm(), HOLE @ pose_hole_peg @ WORKCELL.pose_flange_peg().inverse(), WORKCELL.home_joints_rad
    )


def press(engine: Physics, start: Pose, end: Pose, hold: int = 500) -> Array:
    """From start to end in 0.4 s, then hold: the wrenches (hold, 6) that were sensed while holding."""
    first, last = joints_at(start), joints_at(end)
    engine.build(HOLE, first)
    still = np.zeros(len(first))
    for step in range(1, 401):
        engine.step(first + (last - first) * step / 400.0, (last - first) / 0.4, still)
    sensed = []
    for _ in range(hold):
        engine.step(last, still, still)
        sensed.append(engine.wrench_sensed())
    return np.array(sensed)


def touching(engine: Physics, turn_rad: Array, aside_m: Array) -> Pose:
    """The pose of the peg, so turned and aside, at which it first touches on its way along the hole's axis."""
    free_m, deep_m = -TIP_M, 0.0
    while deep_m - free_m > 1e-6:
        middle_m = (free_m + deep_m) / 2.0
        engine.build(HOLE, joints_at(Pose.from_rotvec(turn_rad, [*aside_m, middle_m])))
        if engine.deepest_penetration_m() > 0.0:
            deep_m = middle_m
        else:
            free_m = middle_m
    return Pose.from_rotvec(turn_rad, [*aside_m, free_m])


def weight(pose_base_peg: Pose) -> Array:
    force = pose_base_peg.rotation.T @ np.array([0.0, 0.0, -9.81 * FT.payload_kg])
    return wrench_of_force_at_point(force, np.asarray(FT.payload_centroid_m))


def contact_wrench(engine: Physics) -> Array:
    into_peg = engine.pose_base_peg().inverse()
    total = np.zeros(6)
    for contact in engine.contacts():
        total += wrench_of_force_at_point(into_peg.rotate(contact.force_base_n), into_peg.apply(contact.point_base_m))
    return total


@EVERY
def test_at_rest_the_sensor_reads_the_weight_and_the_arm_does_not_sag(name: str) -> None:
    with opened(name) as engine:
        for joints in (WORKCELL.home_joints_rad, (-1.0, 0.4, -0.5, 0.7, -0.9, 1.2), (0.3, 0.9, -1.2, -2.0, 1.1, 3.0)):
            reference, still = np.asarray(joints), np.zeros(6)
            engine.build(HOLE, reference)
            for _ in range(300):
                engine.step(reference, still, still)
            np.testing.assert_allclose(engine.joints_rad, reference, atol=1e-9)
            expected = weight(WORKCELL.pose_base_peg(reference))
            np.testing.assert_allclose(engine.wrench_sensed(), expected, atol=2e-5)
            assert engine.contacts() == []


@EVERY
def test_in_motion_the_sensor_reads_the_weight_less_the_inertia(name: str) -> None:
    """Accelerated for 40 ms: the mean of what is sensed is m (g - a) of the payload's centroid, to 2 %."""
    with opened(name) as engine:
        start = np.asarray(WORKCELL.home_joints_rad)
        direction = np.array([0.5, -0.3, 0.2, 0.1, -0.2, 0.4])
        engine.build(HOLE, start)
        forces, centroids = [], []
        for step in range(1, 201):
            at_s = step * 1e-3
            engine.step(start + direction * 2.0 * at_s**2, direction * 4.0 * at_s, direction * 4.0)
            pose = engine.pose_base_peg()
            forces.append(pose.rotation @ engine.wrench_sensed()[:3])
            centroids.append(pose.apply(FT.payload_centroid_m))
        acceleration = np.diff(centroids, n=2, axis=0)[100:180].mean(axis=0) / 1e-6
        expected = FT.payload_kg * (np.array([0.0, 0.0, -9.81]) - acceleration)
        felt = np.array(forces)[102:182].mean(axis=0)
        assert np.linalg.norm(acceleration) > 1.0
        np.testing.assert_allclose(felt, expected, atol=0.02 * FT.payload_kg * float(np.linalg.norm(acceleration)))


@EVERY
def test_what_is_sensed_is_weight_and_contacts_and_bends_the_joints_as_stiffness_says(name: str) -> None:
    with opened(name) as engine:
        start = touching(engine, np.array([-0.05, 0.03, 0.02]), np.array([-0.0005, 0.0012]))
        end = Pose(start.rotation, start.translation_m + np.array([0.0, 0.0, 0.001]))
        sensed = press(engine, start, end)[-1]
        contact = sensed - weight(engine.pose_base_peg())
        assert 5.0 < np.linalg.norm(contact[:3]) < 500.0
        # one millisecond lies between the contacts' forces and the pose
        np.testing.assert_allclose(contact_wrench(engine), contact, atol=2e-3 * float(np.linalg.norm(contact[:3])))
        twist = WORKCELL.compliance_peg(joints_at(end)) @ contact
        bent = HOLE @ end @ Pose.from_rotvec(twist[3:], twist[:3])
        deflection_m = float(np.linalg.norm(twist[:3]))
        assert bent.distance_to_m(engine.pose_base_peg()) < 0.02 * deflection_m


@EVERY
def test_friction_that_holds_does_not_creep(name: str) -> None:
    with opened(name, SimulatedConfig(friction_coefficient=0.3)) as engine:
        sensed = press(engine, Pose.from_translation([0, 0, -0.020]), Pose.from_translation([4e-4, 0, -0.020]), 1000)
        assert np.linalg.norm(sensed[-1, :3] - weight(engine.pose_base_peg())[:3]) > 15.0
        assert np.abs(sensed[-1] - sensed[500]).max() < 0.01


@EVERY
def test_a_world_built_anew_repeats_to_the_last_bit(name: str) -> None:
    start, end = Pose.from_translation([1e-3, 0, -TIP_M - 0.001]), Pose.from_translation([1e-3, 0, -TIP_M + 0.02])
    with opened(name) as engine, opened(name) as other:
        first = press(engine, start, end, 50)
        press(engine, Pose.from_translation([0, 0, -0.020]), Pose.from_translation([4e-4, 0, -0.020]), 50)
        assert np.array_equal(press(engine, start, end, 50), first)
        assert np.array_equal(press(other, start, end, 50), first)


@EVERY
def test_overlap_is_measured(name: str) -> None:
    with opened(name) as engine:
        for depth_m in (0.0001, 0.001):
            engine.build(HOLE, joints_at(Pose.from_translation([0.035, 0.02, -TIP_M + depth_m])))
            assert engine.deepest_penetration_m() == pytest.approx(depth_m, rel=0.02, abs=3e-6)
        engine.build(HOLE, joints_at(Pose.from_translation([0.035, 0.02, -TIP_M - 0.0001])))
        assert engine.deepest_penetration_m() == 0.0
        assert engine.contacts() == []


@EVERY
def test_a_sensor_that_is_mounted_otherwise_feels_it_in_its_own_frame(name: str) -> None:
    turned = SimulatedConfig(truth=TruthConfig(ft_turn_rad=(0.0, 0.0, 0.3), ft_shift_m=(0.01, 0.0, 0.0)))
    with opened(name) as straight, opened(name, turned) as mounted:
        for engine in (straight, mounted):
            engine.build(HOLE, np.asarray(WORKCELL.home_joints_rad))
            engine.step(np.asarray(WORKCELL.home_joints_rad), np.zeros(6), np.zeros(6))
        into = Pose.from_rotvec([0.0, 0.0, 0.3], [0.01, 0.0, 0.0]).inverse()
        force, moment = straight.wrench_sensed()[:3], straight.wrench_sensed()[3:]
        expected = [*into.rotate(force), *into.rotate(moment - np.cross([0.01, 0.0, 0.0], force))]
        np.testing.assert_allclose(mounted.wrench_sensed(), expected, atol=1e-9)


@EVERY
@pytest.mark.parametrize("arm", ["ur5e", "panda"])
@pytest.mark.parametrize("stiffness", [0.3, 3.0])
def test_any_arm_holds_its_payload_and_bends_as_its_stiffness_says(name: str, arm: str, stiffness: float) -> None:
    workcell = load_cell(CELLS / f"{arm}.yaml").workcell
    config = SimulatedConfig(truth=TruthConfig(joint_stiffness_factor=stiffness))
    engine = open_engine(name, workcell, config)
    try:
        hole, from_flange = workcell.hole_prior.pose_base_hole(), workcell.pose_flange_peg().inverse()
        seated, aside = Pose.from_translation([0.0, 0.0, -0.020]), Pose.from_translation([4e-4, 0.0, -0.020])
        first = nearest(workcell.arm(), hole @ seated @ from_flange, workcell.home_joints_rad)
        last = nearest(workcell.arm(), hole @ aside @ from_flange, first)
        still = np.zeros(len(first))
        engine.build(hole, first)
        for _ in range(100):
            engine.step(first, still, still)
        np.testing.assert_allclose(engine.joints_rad, first, atol=1e-9)
        np.testing.assert_allclose(engine.wrench_sensed(), weight(engine.pose_base_peg()), atol=2e-5)
        for step in range(1, 901):
            share = min(1.0, step / 400.0)
            engine.step(first + (last - first) * share, (last - first) / 0.4 * (share < 1.0), still)
        contact = engine.wrench_sensed() - weight(engine.pose_base_peg())
        twist = workcell.compliance_peg(last) / stiffness @ contact
        bent = hole @ aside @ Pose.from_rotvec(twist[3:], twist[:3])
        assert np.linalg.norm(twist[:3]) > 2e-4
        assert bent.distance_to_m(engine.pose_base_peg()) < 1e-6
    finally:
        engine.close()


@pytest.mark.skipif(len(installed_engines()) < 2, reason="wants both engines")
def test_the_engines_agree() -> None:
    """The same press without friction: the same direction to 0.05 degrees, and forces as far apart as 15 um are."""
    rng = np.random.default_rng(3)
    with (
        opened("pybullet", SimulatedConfig(friction_coefficient=0.0)) as one,
        opened("mujoco", SimulatedConfig(friction_coefficient=0.0)) as other,
    ):
        compared = 0
        for _ in range(6):
            turn, aside = rng.uniform(-0.06, 0.06, 3), rng.uniform(-0.002, 0.002, 2)
            start = touching(other, turn, aside)
            end = Pose(start.rotation, start.translation_m + np.array([0.0, 0.0, 0.001]))
            forces = []
            for engine in (one, other):
                sensed = press(engine, start, end, 300)[-1]
                forces.append((sensed - weight(engine.pose_base_peg()))[:3])
            if len(one.contacts()) != 1 or len(other.contacts()) != 1:
                continue
            sine = np.linalg.norm(np.cross(*forces)) / np.prod(np.linalg.norm(forces, axis=1))
            assert np.degrees(np.arcsin(sine)) < 0.05
            stiffness_n_m = 1.5e5
            assert np.linalg.norm(forces[0] - forces[1]) < stiffness_n_m * 15e-6
            compared += 1
        assert compared >= 3


@pytest.mark.skipif(len(installed_engines()) < 2, reason="wants both engines")
def test_the_engines_weigh_the_arm_alike() -> None:
    """The same feed-forward: after a free swing both link sides are where they were, to a micrometre at the peg."""
    places = []
    for name in ENGINES:
        with opened(name) as engine:
            start = np.asarray(WORKCELL.home_joints_rad)
            engine.build(HOLE, start)
            for step in range(1, 301):
                engine.step(start + 0.1 * step / 300.0, np.full(6, 0.1 / 0.3), np.zeros(6))
            places.append(engine.pose_base_peg())
    assert places[0].distance_to_m(places[1]) < 2e-5


def test_the_joints_of_the_xb4_are_where_its_drawing_says() -> None:
    axes, origins_m = joint_lines(WORKCELL.arm())
    assert axes.tolist() == [[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]]
    np.testing.assert_allclose(origins_m[4], [0.040 + 0.280, 0.0, 0.342 + 0.275 + 0.025], atol=1e-15)


def test_link_masses_of_the_cells_file_are_taken_and_counted() -> None:
    given = SimulatedConfig(link_masses_kg=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    assert arm_bodies(WORKCELL, given).link_kg.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    wrong = SimulatedConfig(joint_inertias_kg_m2=(0.1, 0.1))
    with pytest.raises(ConfigError, match=r"joint_inertias_kg_m2 has 2 numbers; arm 'xb4' wants 6"):
        link_masses(WORKCELL.arm(), np.ones(6), wrong)


def test_auto_takes_the_first_that_is_installed() -> None:
    assert chosen_engine(AUTO) == installed_engines()[0]


def test_a_name_that_is_no_engine_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"hardware\.engine: no engine 'bullet'; want auto, pybullet, mujoco"):
        chosen_engine("bullet")


def test_an_engine_that_is_not_installed_is_named_with_the_mend(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "ENGINES", ("pybullet", "no_such_engine_here"))
    with pytest.raises(ConfigError, match=r"no_such_engine_here is not installed; pip install"):
        chosen_engine("no_such_engine_here")


@EVERY
def test_only_the_engine_asked_for_is_imported(name: str) -> None:
    others = [other for other in ENGINES if other != name]
    code = (
        "import sys\n"
        "from crosspih_common.config import Workcell\n"
        "from services.hardware.drivers.simulated import cell\n"
        "from services.hardware.drivers.simulated.config import SimulatedConfig\n"
        "from services.hardware.drivers.simulated.engines.registry import open_engine\n"
        f"open_engine({name!r}, Workcell(), SimulatedConfig()).close()\n"
        f"assert {name!r} in sys.modules and not set({others!r}) & set(sys.modules), sorted(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@EVERY
@pytest.mark.parametrize("stiffness_n_m", [3e4, 3e5])
def test_a_contact_that_gives_way_has_the_stiffness_it_was_given(name: str, stiffness_n_m: float) -> None:
    with opened(name, SimulatedConfig(contact_stiffness_n_m=stiffness_n_m)) as engine:
        start = touching(engine, np.zeros(3), np.array([0.03, 0.03]))
        end = start @ Pose.from_translation([0.0, 0.0, 2e-4])
        sensed = press(engine, start @ Pose.from_translation([0.0, 0.0, -2e-4]), end, hold=200)
        strongest_n = max(float(np.linalg.norm(contact.force_base_n)) for contact in engine.contacts())
        assert strongest_n == pytest.approx(stiffness_n_m * engine.deepest_penetration_m(), rel=0.05)
        assert float(sensed[-100:, :3].std(axis=0).max()) < 0.05
