"""The factors by which a cell may differ from the default, one at a time, and their levels. Pure.

Clearance, the expected friction and stiffness stand in the cell's file, so the services know them. Fields under
`hardware.simulated` belong to the simulator alone: a service detects such a difference, or does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from crosspih_common.config import Workcell
from services.operator.bench.cells.conditions import Condition, merged
from services.operator.bench.contact_states.plan import lateral_stiffness_n_m

# values of the simulated cell where its file sets none: the hardware service's own defaults
SIMULATED_DEFAULTS: dict[str, Any] = {
    "friction_coefficient": 0.1,
    "force_torque": {"noise_n": 0.1, "noise_nm": 0.005},
}
CLEARANCES_MM = (0.05, 0.1, 0.2, 0.5)
FRICTIONS = (0.0, 0.1, 0.2, 0.3)
STIFFNESSES_N_MM = (20.0, 100.0, 200.0)


@dataclass(frozen=True)
class FactorLevel:
    """One box of the map: its name, and the overrides that produce it."""

    name: str
    overrides: dict[str, Any]

    @property
    def is_default(self) -> bool:
        """Whether it is the default cell."""
        return not self.overrides


@dataclass(frozen=True)
class Factor:
    """One row of the map. `known`: whether the services know the value."""

    name: str
    known: bool
    levels: tuple[FactorLevel, ...]

    def condition(self, level: FactorLevel) -> Condition:
        """The condition of one of its levels."""
        return Condition(name="default" if level.is_default else f"{self.name} {level.name}", overrides=level.overrides)


def _simulated(**settings: Any) -> dict[str, Any]:
    return {"hardware": {"simulated": settings}}


def _clearance(millimetres: float, default_m: float) -> FactorLevel:
    metres = round(millimetres * 1e-3, 9)
    same = abs(metres - default_m) < 1e-12
    return FactorLevel(f"{millimetres:g} mm", {} if same else {"cell": {"hole": {"clearance_m": metres}}})


def _stiffness(workcell: Workcell, n_mm: float) -> FactorLevel:
    factor = n_mm * 1e3 / lateral_stiffness_n_m(workcell)
    joints = [float(f"{value * factor:.6g}") for value in workcell.joint_stiffness_nm_rad]
    return FactorLevel(f"{n_mm:g} N/mm", {"cell": {"joint_stiffness_nm_rad": joints}})


def factors(workcell: Workcell, hardware: Mapping[str, Any]) -> tuple[Factor, ...]:
    """All factors with their levels, the default's among them, for the cell whose file has this `hardware` section."""
    simulated = merged(SIMULATED_DEFAULTS, hardware.get("simulated") or {})
    noise, friction = simulated["force_torque"], simulated["friction_coefficient"]
    own = FactorLevel(f"{lateral_stiffness_n_m(workcell) * 1e-3:.0f} N/mm", {})
    stiffness = [_stiffness(workcell, n_mm) for n_mm in STIFFNESSES_N_MM]
    by_stiffness = sorted([own, *stiffness], key=lambda level: float(level.name.split()[0]))
    return (
        Factor(
            "clearance", True,
            tuple(_clearance(value, workcell.hole.clearance_m) for value in CLEARANCES_MM),
        ),
        Factor(
            "friction", False,
            tuple(
                FactorLevel(f"{value:g}", {} if value == friction else _simulated(friction_coefficient=value))
                for value in FRICTIONS
            ),
        ),
        Factor("stiffness", True, tuple(by_stiffness)),
        Factor(
            "F/T noise", False,
            (
                FactorLevel("x1", {}),
                FactorLevel(
                    "x3", _simulated(force_torque={name: 3.0 * noise[name] for name in ("noise_n", "noise_nm")})
                ),
            ),
        ),
        Factor(
            "F/T drift", False,
            (
                FactorLevel("none", {}),
                FactorLevel("0.02 N/s", _simulated(force_torque={"drift_n_s": 0.02})),
                FactorLevel("0.05 N/s", _simulated(force_torque={"drift_n_s": 0.05})),
            ),
        ),
        Factor(
            "camera off by", False,
            (
                FactorLevel("nothing", {}),
                FactorLevel("2 mm aside", _simulated(truth={"camera_shift_m": [0.002, 0.0, 0.0]})),
                FactorLevel("2 mm along", _simulated(truth={"camera_shift_m": [0.0, 0.0, 0.002]})),
                # rotating the camera to the right moves the hole to the left, as shifting it to the right does
                FactorLevel("0.5° pan", _simulated(truth={"camera_turn_rad": [0.0, 0.00872665, 0.0]})),
                FactorLevel("0.5° roll", _simulated(truth={"camera_turn_rad": [0.0, 0.0, 0.00872665]})),
            ),
        ),
        Factor(
            "taper off by", False,
            (
                FactorLevel("nothing", {}),
                FactorLevel("-1 %", _simulated(truth={"taper_slope_factor": 0.99})),
                FactorLevel("+1 %", _simulated(truth={"taper_slope_factor": 1.01})),
            ),
        ),
        Factor(
            "light", False,
            (
                FactorLevel("usual", {}),
                FactorLevel("dim, x0.3", _simulated(camera={"brightness": 0.3})),
                FactorLevel("glaring", _simulated(camera={"glare": 200.0})),
            ),
        ),
    )  # fmt: skip
