"""The admittance law in plain floats against the same law in NumPy and SciPy, and against what can be told by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from crosspih_common.geometry.pose import Array
from crosspih_common.geometry.rows import Rows, matrix_of, rows_of, turned
from crosspih_common.messages import AdmittanceMove
from crosspih_common.wrench import Payload, SensorMounting
from services.hardware.control.admittance_law import AdmittanceLaw

CLOSE = 1e-12

forces = st.tuples(*[st.floats(-100.0, 100.0)] * 3)
moments = st.tuples(*[st.floats(-10.0, 10.0)] * 3)
lengths = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
rotations = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(lambda rotvec: Rotation.from_rotvec(rotvec).as_matrix())
directions = lengths.filter(lambda vector: np.linalg.norm(vector) > 1e-2).map(lambda v: np.array(v) / np.linalg.norm(v))


def command(centre_m: tuple[float, ...], gain: float = 1.0) -> AdmittanceMove:
    """A move about a centre (3,); the smaller the gain, the softer it yields."""
    return AdmittanceMove(
        direction_base=(0.0, 0.0, 1.0), travel_m=0.01, speed_m_s=0.02, timeout_s=1.0, centre_peg_m=centre_m,
        axial_force_n=30.0, lateral_damping_n_s_m=2000.0 * gain, rotational_damping_nm_s_rad=20.0 * gain,
    )  # fmt: skip


def in_numpy(wrench: Array, rotation: Array, direction: Array, asked: AdmittanceMove) -> tuple[float, Array, Array]:
    """The equations as docs and literature have them, an array a vector."""

    def clip(vector: Array, length: float) -> Array:
        size = float(np.linalg.norm(vector))
        return vector if size <= length else vector * (length / size)

    force = rotation @ wrench[:3]
    about = wrench[3:] - np.cross(asked.centre_peg_m, wrench[:3])
    axial = -float(force @ direction)
    lateral = clip((force + direction * axial) / asked.lateral_damping_n_s_m, asked.lateral_speed_limit_m_s)
    turn = clip(rotation @ about / asked.rotational_damping_nm_s_rad, asked.rotational_speed_limit_rad_s)
    load = max(
        axial / asked.axial_force_n,
        0.5 * float(np.linalg.norm(force)) / asked.axial_force_n,
        float(np.linalg.norm(about)) / 4.0,
    )
    return asked.speed_m_s * float(np.clip(1.0 - load, -1.0, 1.0)), lateral, turn


@given(
    force=forces, moment=moments, centre=lengths, rotation=rotations, direction=directions, gain=st.floats(0.01, 100.0)
)
def test_the_law_is_that_of_numpy(
    force: tuple[float, ...], moment: tuple[float, ...], centre: tuple[float, ...], rotation: Array, direction: Array,
    gain: float,
) -> None:  # fmt: skip
    asked = command(centre, gain)
    wrench = np.array([*force, *moment])
    axial, lateral, turn = AdmittanceLaw.of(asked, direction.tolist()).yielding(wrench.tolist(), rows_of(rotation))
    wanted_axial, wanted_lateral, wanted_turn = in_numpy(wrench, rotation, direction, asked)
    assert axial == pytest.approx(wanted_axial, abs=CLOSE)
    assert lateral == pytest.approx(wanted_lateral, abs=CLOSE)
    assert turn == pytest.approx(wanted_turn, abs=CLOSE)
    assert np.linalg.norm(lateral) <= asked.lateral_speed_limit_m_s * (1.0 + CLOSE)
    assert np.linalg.norm(turn) <= asked.rotational_speed_limit_rad_s * (1.0 + CLOSE)


def test_a_free_peg_goes_as_asked_and_a_pressed_one_comes_back() -> None:
    law = AdmittanceLaw.of(command((0.0, 0.0, 0.1)), [0.0, 0.0, 1.0])
    straight = rows_of(np.eye(3))
    assert law.yielding([0.0] * 6, straight) == (0.02, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    # pressed back along the push by F_max it stands, by twice that it comes back as fast as it went
    assert law.yielding([0.0, 0.0, -30.0, 0.0, 0.0, 0.0], straight)[0] == 0.0
    assert law.yielding([0.0, 0.0, -60.0, 0.0, 0.0, 0.0], straight)[0] == -0.02
    # 4 N across at the centre, felt as 4 N and 0.4 Nm at the peg frame's origin: it slides, and does not turn
    _, lateral, turn = law.yielding([4.0, 0.0, 0.0, 0.0, 0.4, 0.0], straight)
    assert lateral == pytest.approx((4.0 / 2000.0, 0.0, 0.0)) and turn == pytest.approx((0.0, 0.0, 0.0))


@given(rotation=rotations, turn=st.tuples(*[st.floats(-5e-3, 5e-3)] * 3))
def test_a_small_turn_is_that_of_scipy(rotation: Array, turn: tuple[float, float, float]) -> None:
    after = matrix_of(turned(rows_of(rotation), *turn))
    np.testing.assert_allclose(after, Rotation.from_rotvec(turn).as_matrix() @ rotation, rtol=0.0, atol=CLOSE)


def test_a_whole_turn_by_small_ones_comes_back_and_stays_a_rotation() -> None:
    start: Rows = rows_of(Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix())
    rows, count = start, 2000
    for _ in range(count):
        rows = turned(rows, 0.0, 2.0 * np.pi / count, 0.0)
    assert rows == pytest.approx(start, abs=1e-10)
    np.testing.assert_allclose(matrix_of(rows) @ matrix_of(rows).T, np.eye(3), rtol=0.0, atol=1e-10)


@given(weight=forces, centroid=lengths, bias=st.tuples(forces, moments), rotation=rotations)
def test_what_hangs_on_the_sensor_weighs_the_same_in_plain_floats(
    weight: tuple[float, ...], centroid: tuple[float, ...], bias: tuple[tuple[float, ...], tuple[float, ...]],
    rotation: Array,
) -> None:  # fmt: skip
    mounting = SensorMounting(sign=-1, axes=np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    payload = Payload(np.array([*bias[0], *bias[1]]), np.array(weight), np.array(centroid), mounting)
    assert payload.load_of(rows_of(rotation)) == pytest.approx(payload.load(rotation), abs=CLOSE, rel=CLOSE)
