"""The admittance law: how fast a peg yields to what it feels (Seraji 1994; Villani and De Schutter, "Force Control",
Springer Handbook of Robotics, section 9.2).

The contact wrench is turned into velocity about a centre near the rim, c in the peg frame:

    v_lateral = F_lateral / D,   w = (M - c x F) / D_r,   v_axial = v (1 - load / F_max)

each clipped. The load is the axial force, or a share of |F| when the peg leans on a wall, or of |M|: a wedged peg can
carry far more than its axial force says. A load beyond F_max lets the peg come back.

All in plain floats: of three numbers or nine, a call of NumPy costs more than the sums, and this is reckoned in every
cycle. tests/hardware/control/test_admittance_law.py holds it to the same law in NumPy and SciPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

from crosspih_common.geometry.rows import Rows
from crosspih_common.messages import AdmittanceMove

Vector3 = tuple[float, float, float]

_MOMENT_LOAD_NM = 4.0


@dataclass(frozen=True, slots=True)
class AdmittanceLaw:
    """What one move is told of it. SI units; `direction` is unit, in the base frame, `centre` in the peg frame."""

    direction: Vector3
    centre_m: Vector3
    speed_m_s: float
    axial_force_n: float
    lateral_damping_n_s_m: float
    lateral_limit_m_s: float
    rotational_damping_nm_s_rad: float
    rotational_limit_rad_s: float

    @classmethod
    def of(cls, command: AdmittanceMove, direction_base: Sequence[float]) -> AdmittanceLaw:
        """As a command asks, along a unit direction (3,)."""
        dx, dy, dz = direction_base
        x, y, z = command.centre_peg_m
        return cls(
            direction=(float(dx), float(dy), float(dz)), centre_m=(x, y, z), speed_m_s=command.speed_m_s,
            axial_force_n=command.axial_force_n, lateral_damping_n_s_m=command.lateral_damping_n_s_m,
            lateral_limit_m_s=command.lateral_speed_limit_m_s,
            rotational_damping_nm_s_rad=command.rotational_damping_nm_s_rad,
            rotational_limit_rad_s=command.rotational_speed_limit_rad_s,
        )  # fmt: skip

    def yielding(self, wrench_peg: Sequence[float], rotation_base_peg: Rows) -> tuple[float, Vector3, Vector3]:
        """(speed along the direction, m/s; velocity across it, m/s, and turning speed, rad/s, in the base frame).

        `wrench_peg` (6,) is the contact wrench on the peg, N and Nm, in the peg frame about its origin;
        `rotation_base_peg` is row by row.
        """
        fx, fy, fz, mx, my, mz = wrench_peg
        r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_base_peg
        dx, dy, dz = self.direction
        cx, cy, cz = self.centre_m
        # the force in the base frame, F
        bx = r00 * fx + r01 * fy + r02 * fz
        by = r10 * fx + r11 * fy + r12 * fz
        bz = r20 * fx + r21 * fy + r22 * fz
        # the moment about the centre in the peg frame: M - c x F
        mx -= cy * fz - cz * fy
        my -= cz * fx - cx * fz
        mz -= cx * fy - cy * fx
        axial_n = -(bx * dx + by * dy + bz * dz)
        damping = self.lateral_damping_n_s_m
        lateral = clipped(
            (bx + dx * axial_n) / damping, (by + dy * axial_n) / damping, (bz + dz * axial_n) / damping,
            self.lateral_limit_m_s,
        )  # fmt: skip
        damping = self.rotational_damping_nm_s_rad
        turn = clipped(
            (r00 * mx + r01 * my + r02 * mz) / damping, (r10 * mx + r11 * my + r12 * mz) / damping,
            (r20 * mx + r21 * my + r22 * mz) / damping, self.rotational_limit_rad_s,
        )  # fmt: skip
        load = max(
            axial_n / self.axial_force_n,
            0.5 * sqrt(fx * fx + fy * fy + fz * fz) / self.axial_force_n,
            sqrt(mx * mx + my * my + mz * mz) / _MOMENT_LOAD_NM,
        )
        return self.speed_m_s * min(1.0, max(-1.0, 1.0 - load)), lateral, turn


def clipped(x: float, y: float, z: float, length: float) -> Vector3:
    """A vector no longer than a length, its direction kept."""
    size = sqrt(x * x + y * y + z * z)
    if size <= length:
        return x, y, z
    share = length / size
    return x * share, y * share, z * share
