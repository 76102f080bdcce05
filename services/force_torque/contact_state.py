"""Which of the 26 contact states a wrench shows: count from n_z0, sense from Mz, case from the signs (Tables 2-5).

The printed bands of n_z0 apply to pushes of equal force. A real contact may share its force unequally, rest on walls
of both senses, or bind in the body. So a state comes with a confidence, and "none of these" with the reason.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import atan, atan2, erf, hypot, pi, sqrt, tan

import numpy as np
from numpy.typing import ArrayLike

from crosspih_common.contacts.axial_share import with_friction
from crosspih_common.geometry.pose import Array
from services.force_torque.contact_table import STATES, Signs, StateRow, signs_text

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
_AXIAL_SHARE = 0.2894  # axial over lateral force of one push without friction, from the printed mean n_z0 of .278


@dataclass(frozen=True, slots=True)
class CountBand:
    """The range of |n_z0| for one number of contacts, and its middle, where the confidence is 1."""

    count: int
    low: float
    middle: float
    high: float

    def confidence(self, n_z0: float | Array) -> Array:
        """1 at the middle, 1/2 at the printed ends, 0 as far outside an end as the middle is inside."""
        n = np.asarray(n_z0, dtype=float)
        half = np.where(n < self.middle, self.middle - self.low, self.high - self.middle)
        return np.clip(1.0 - 0.5 * np.abs(n - self.middle) / np.maximum(half, 1e-12), 0.0, 1.0)


COUNT_BANDS: tuple[CountBand, ...] = (
    CountBand(1, 0.23, 0.27, 0.31),
    CountBand(2, 0.33, 0.375, 0.42),
    CountBand(3, 0.58, 0.645, 0.71),
    # "About 1" in print; the lower end is our choice. Nothing lies above 1, so its far side is never used.
    CountBand(4, 0.92, 1.0, 1.08),
)


@lru_cache(maxsize=64)
def count_bands(friction: float = 0.0) -> tuple[CountBand, ...]:
    """The bands of n_z0, shifted for a friction coefficient; the printed ones for 0."""
    return tuple(
        CountBand(band.count, *(with_friction(n, band.count, friction) for n in (band.low, band.middle, band.high)))
        for band in COUNT_BANDS
    )


@dataclass(frozen=True, slots=True)
class ClassifierSettings:
    """Noise of the given wrench (one standard deviation per component), and the rules for a zero component.

    A component is zero below `noise_sigmas` standard deviations or if it is small in its group: of two lateral
    components the smaller one if the vector is within `axis_half_angle_rad` of the other's axis; both if the lateral
    force is below `lateral_ratio` of the total. `moment_offset_nm` is the moment error left by calibration.
    `minimum_confidence` is the least confidence of a state.

    Two lengths separate taper contacts of one sense from anything else, for any number and shares: |Mz / Fz| (arm lever
    over axial share; the paper's ten samples: 0.055-0.089 m) and the height z of the lateral force ahead of the
    origin (its samples: 0.058-0.066 m). Their confidence is 0, 1, 1, 0 at the four corners given, linear between.

    `friction` is the coefficient between peg and hole, known or estimated: it tilts the force of every push backwards,
    so the bands of n_z0 move up and |Mz / Fz| shrinks. The printed bands are those without friction.
    """

    force_sd_n: float = 0.1
    moment_sd_nm: float = 0.005
    noise_sigmas: float = 3.0
    axis_half_angle_rad: float = pi / 8.0
    lateral_ratio: float = 0.45
    moment_offset_nm: float = 0.002
    minimum_force_n: float = 1.0
    minimum_yaw_ratio: float = 0.05
    minimum_confidence: float = 0.2
    yaw_length_m: tuple[float, float, float, float] = (0.02, 0.045, 0.1, 0.15)
    height_m: tuple[float, float, float, float] = (0.03, 0.05, 0.08, 0.1)
    friction: float = 0.0

    def __post_init__(self) -> None:
        if self.force_sd_n < 0.0 or self.moment_sd_nm < 0.0 or self.moment_offset_nm < 0.0:
            raise ValueError("ClassifierSettings wants force_sd_n, moment_sd_nm and moment_offset_nm of 0 or more")
        if not 0.0 < self.axis_half_angle_rad < pi / 4.0 or not 0.0 < self.lateral_ratio < 1.0:
            raise ValueError("ClassifierSettings wants axis_half_angle_rad in (0, pi/4) and lateral_ratio in (0, 1)")
        if not 0.0 <= self.friction <= 1.0:
            raise ValueError(f"ClassifierSettings wants friction in [0, 1], got {self.friction}")
        for name in ("yaw_length_m", "height_m"):
            a, b, c, d = getattr(self, name)
            if not 0.0 <= a < b <= c < d:
                raise ValueError(f"ClassifierSettings wants {name} as four rising lengths, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True)
class ContactStateResult:
    """A state with its confidence (0..1), or none with the reason; `n_z0` is -Fz/|F| (the printed, signless n_z0).

    `signs`: of Fx Fy Fz Mx My Mz. `runner_up`: the next best row that the signs allow.
    `count_confidence` (n_z0 in its band), `sense_confidence` (Mz beyond noise), `direction_confidence` (lateral force
    and moment along the row's), `lever_confidence` (|Mz / Fz| and height as for taper contacts of one sense) are the
    factors of `confidence`.
    """

    state: StateRow | None
    confidence: float
    reason: str
    n_z0: float
    signs: Signs
    count_confidence: float = 0.0
    sense_confidence: float = 0.0
    direction_confidence: float = 0.0
    lever_confidence: float = 0.0
    runner_up: StateRow | None = None
    runner_up_confidence: float = 0.0

    @property
    def name(self) -> str:
        """The state's name, or "none"."""
        return "none" if self.state is None else self.state.name


def wrench_signs(wrench: ArrayLike, settings: ClassifierSettings) -> Signs:
    """The sign of each component (6,): -1, 0 or +1, zero where noise or scale does not allow a sign."""
    w = np.asarray(wrench, dtype=float)
    fx, fy, fz, mx, my, mz = w.tolist()
    force_floor = settings.noise_sigmas * settings.force_sd_n
    moment_floor = settings.noise_sigmas * settings.moment_sd_nm + settings.moment_offset_nm
    force, moment = float(np.linalg.norm(w[:3])), float(np.linalg.norm(w[3:]))
    slope = tan(settings.axis_half_angle_rad)

    def pair(a: float, b: float, floor: float, whole: float) -> tuple[int, int]:
        if hypot(a, b) <= max(floor, settings.lateral_ratio * whole):
            return 0, 0
        return _sign(a, max(floor, slope * abs(b))), _sign(b, max(floor, slope * abs(a)))

    sx, sy = pair(fx, fy, force_floor, force)
    mxs, mys = pair(mx, my, moment_floor, moment)
    sz = _sign(fz, max(force_floor, 0.05 * force))
    mzs = _sign(mz, max(moment_floor, settings.minimum_yaw_ratio * moment))
    return sx, sy, sz, mxs, mys, mzs


def _sign(value: float, floor: float) -> int:
    return 0 if abs(value) <= floor else (1 if value > 0.0 else -1)


def classify_contact(wrench_peg: ArrayLike, settings: ClassifierSettings | None = None) -> ContactStateResult:
    """The contact state of a compensated wrench (6,) on the peg, in the peg frame; ValueError unless six are finite."""
    settings = ClassifierSettings() if settings is None else settings
    wrench = np.asarray(wrench_peg, dtype=float)
    if wrench.shape != (6,) or not np.all(np.isfinite(wrench)):
        raise ValueError(f"wrench_peg wants six finite numbers, got {wrench!r}")
    force = float(np.linalg.norm(wrench[:3]))
    signs = wrench_signs(wrench, settings)
    n_z0 = -float(wrench[2]) / force if force > 0.0 else 0.0

    def none(reason: str) -> ContactStateResult:
        return ContactStateResult(None, 0.0, reason, n_z0, signs)

    if force < max(settings.minimum_force_n, settings.noise_sigmas * settings.force_sd_n):
        return none(f"no contact: |F| = {force:.2f} N")
    if signs[2] >= 0:
        return none(f"Fz = {wrench[2]:.2f} N does not push the peg back: not a taper contact")
    if signs[5] == 0:
        return none(f"Mz = {wrench[5]:.4f} Nm has no sign beyond noise and scale: walls of both senses, or of none")
    matches = [row for row in STATES if row.signs == signs]
    if not matches:
        return none(f"the signs {signs_text(signs)} stand in no row of Tables 2-5{_sign_hint(signs)}")

    # n = -Fz/|F| has d n = (lateral / |F|) d angle, so its noise is at most sd / |F|.
    n_nodes = n_z0 + settings.force_sd_n / force * _NODES
    bands = count_bands(settings.friction)
    counts = {band.count: float(_WEIGHTS @ band.confidence(np.minimum(n_nodes, 2.0 - n_nodes))) for band in bands}
    sense = _sense_confidence(wrench, settings)
    lever = _lever_confidence(wrench, signs, settings)
    direction = _direction_confidence(wrench, signs, settings)
    # Rows with the same signs differ only in their count.
    ranked = sorted(matches, key=lambda row: (-counts[row.count], row.count))
    best, others = ranked[0], ranked[1:]
    shared = sense * direction * lever
    confidence = counts[best.count] * shared
    result = ContactStateResult(
        state=best,
        confidence=confidence,
        reason="",
        n_z0=n_z0,
        signs=signs,
        count_confidence=counts[best.count],
        sense_confidence=sense,
        direction_confidence=direction,
        lever_confidence=lever,
        runner_up=others[0] if others and counts[others[0].count] > 0.0 else None,
        runner_up_confidence=counts[others[0].count] * shared if others else 0.0,
    )
    if confidence < settings.minimum_confidence:
        reason = _weakest(result, wrench, [band for band in bands if band.count in {row.count for row in matches}])
        return replace(result, state=None, reason=reason, runner_up=None, runner_up_confidence=0.0)
    return result


def _sense_confidence(wrench: Array, settings: ClassifierSettings) -> float:
    """The confidence in the sign of Mz, given the noise and the remaining error of the calibration."""
    sd = hypot(settings.moment_sd_nm, settings.moment_offset_nm)
    return erf(abs(float(wrench[5])) / (sqrt(2.0) * sd)) if sd > 0.0 else 1.0


def contact_height_m(wrench_peg: Array) -> float:
    """The height z ahead of the origin at which the lateral force acts, m: the least-squares z of M = z e_z x F."""
    fx, fy, _, mx, my, _ = np.asarray(wrench_peg, dtype=float).tolist()
    return float((fx * my - fy * mx) / max(fx * fx + fy * fy, 1e-12))


def _lever_confidence(wrench: Array, signs: Signs, settings: ClassifierSettings) -> float:
    # Friction scales the axial share of every push alike, and this ratio with it.
    leaning = tan(atan(_AXIAL_SHARE) + atan(settings.friction)) / _AXIAL_SHARE
    yaw = _trapezoid(abs(float(wrench[5] / wrench[2])) * leaning, settings.yaw_length_m)
    if signs[:2] == (0, 0):
        return yaw
    return min(yaw, _trapezoid(contact_height_m(wrench), settings.height_m))


def _trapezoid(value: float, corners: tuple[float, float, float, float]) -> float:
    return float(np.interp(value, corners, (0.0, 1.0, 1.0, 0.0)))


def _direction_confidence(wrench: Array, signs: Signs, settings: ClassifierSettings) -> float:
    """How well the lateral force and moment point as the signs say: 1 along the direction, 1/2 at the next sector."""
    force, moment = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
    worst = 1.0
    for values, pair, whole, sd in (
        (wrench[:2], signs[:2], force, settings.force_sd_n),
        (wrench[3:5], signs[3:5], moment, settings.moment_sd_nm),
    ):
        size = hypot(*values.tolist())
        if pair == (0, 0):
            worst = min(worst, 1.0 - 0.5 * size / (settings.lateral_ratio * whole))
            continue
        nodes = atan2(values[1], values[0]) - atan2(pair[1], pair[0]) + sd / max(size, 1e-12) * _NODES
        away = np.abs((nodes + pi) % (2.0 * pi) - pi)
        worst = min(worst, float(_WEIGHTS @ np.clip(1.0 - 0.5 * away / settings.axis_half_angle_rad, 0.0, 1.0)))
    return max(0.0, worst)


def _sign_hint(signs: Signs) -> str:
    fx, fy, _, mx, my, _ = signs
    if (mx, my) != (-fy, fx):
        return ": the lateral force and the lateral moment belong to different cases"
    return ""


def _weakest(result: ContactStateResult, wrench: Array, bands: list[CountBand]) -> str:
    """The reason why a row that the signs allow is rejected: its weakest factor, in words."""
    factors = {
        "count": result.count_confidence,
        "lever": result.lever_confidence,
        "sense": result.sense_confidence,
        "direction": result.direction_confidence,
    }
    name = min(factors, key=lambda key: factors[key])
    if name == "count":
        text = " or ".join(f"{band.count} ({band.low:.2f}-{min(band.high, 1.0):.2f})" for band in bands)
        return f"n_z0 = {result.n_z0:.3f} lies outside the band of the counts that the signs allow: {text}"
    if name == "lever":
        yaw_mm, height_mm = abs(wrench[5] / wrench[2]) * 1e3, contact_height_m(wrench) * 1e3
        return (
            f"|Mz/Fz| = {yaw_mm:.0f} mm and height {height_mm:.0f} mm are not those of taper contacts of one sense "
            "(too small: walls of both senses; too large: the body binds)"
        )
    if name == "sense":
        return f"Mz = {wrench[5]:.4f} Nm is too small beside noise to tell the sense"
    return "the lateral force or moment points between two cases"
