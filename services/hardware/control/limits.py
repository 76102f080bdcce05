"""How fast the peg may be where it may touch: speed, threshold, cap, braking distance and delay judged together.

Against a rigid plate, at an approaching speed v, a motion presses with the larger of

    landing    v sqrt(k_c m)                       the momentum of what moves, taken up by the contact
    pressing   F + k (v d + v^2 / 2a)              what is felt when it reacts, then the way until it has stopped

where k_c is the stiffness of a hard contact, m the mass that stops with the tip, k the arm's own stiffness at the tip
(J K^-1 J^T, Salisbury 1980) in series with k_c, d the delay of the loop and a its deceleration. docs/safety.md derives
it. A motion is told to stop where what it feels, plus what its speed will still add, reaches the cap.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from crosspih_common.arm import ArmModel
from crosspih_common.errors import CommandRefused
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import AdmittanceMove, GuardedMove
from services.hardware.control.config import LimitsConfig
from services.hardware.protocols import Landing

CommandT = TypeVar("CommandT", GuardedMove, AdmittanceMove)

CREEP_SHARE = 0.1  # of the cap: what a creep may still add once the cap is reached
PATH_SHARE = 0.98  # of the contact speed: the rest is for the push itself
AXIAL_SHARE = 0.8  # of the cap: the most that a push may be asked to press with
_DELAY_CYCLES = 2.0  # a force is read in the next cycle, and what is written then acts in the one after


@dataclass(frozen=True, slots=True)
class TouchingLimits:
    """What holds for motions that may touch, at one posture. SI units."""

    cap_n: float
    stiffness_n_m: float
    landing_n_s_m: float
    delay_s: float
    braking_m_s2: float

    @classmethod
    def at(
        cls, config: LimitsConfig, landing: Landing, model: ArmModel, stiffness_nm_rad: Array, joints_rad: Array,
        pose_flange_tip: Pose, period_s: float,
    ) -> TouchingLimits:  # fmt: skip
        """With the arm's stiffness at the tip in its stiffest direction; joints (n,), their stiffness (n,)."""
        jacobian = model.jacobian(joints_rad, pose_flange_tip)[:3]
        compliance = jacobian @ np.diag(1.0 / np.asarray(stiffness_nm_rad, float)) @ jacobian.T
        softest_m_n = float(np.linalg.eigvalsh(compliance)[0]) + 1.0 / landing.contact_stiffness_n_m
        return cls(
            cap_n=config.force_cap_n,
            stiffness_n_m=1.0 / softest_m_n,
            landing_n_s_m=float(np.sqrt(landing.contact_stiffness_n_m * landing.moved_mass_kg)),
            delay_s=config.sensor_delay_s + _DELAY_CYCLES * period_s,
            braking_m_s2=config.braking_m_s2,
        )

    def adds_n(self, speed_m_s: float) -> float:
        """What a motion at this speed still presses after it should stop, N: k (v d + v^2 / 2a)."""
        return self.stiffness_n_m * (speed_m_s * self.delay_s + 0.5 * speed_m_s**2 / self.braking_m_s2)

    def stopping_speed_m_s(self, room_n: float) -> float:
        """The speed whose `adds_n` is the room, m/s."""
        a, d = self.braking_m_s2, self.delay_s
        return float(a * (np.sqrt(d * d + 2.0 * max(room_n, 0.0) / (self.stiffness_n_m * a)) - d))

    def contact_speed_m_s(self, threshold_n: float = 0.0) -> float:
        """The fastest that a motion which reacts at a threshold may meet a rigid plate, m/s."""
        return min(self.cap_n / self.landing_n_s_m, self.stopping_speed_m_s(self.cap_n - threshold_n))

    def creep_speed_m_s(self) -> float:
        """The fastest that a motion may go on pressing until the cap stops it, m/s."""
        return self.stopping_speed_m_s(CREEP_SHARE * self.cap_n)


def judged_guarded(command: GuardedMove, limits: TouchingLimits) -> tuple[GuardedMove, list[str]]:
    """The command with speeds that keep it under the cap, and what was slowed. Raises CommandRefused cap."""
    if command.force_threshold_n > AXIAL_SHARE * limits.cap_n:
        raise CommandRefused(
            "cap",
            f"force_threshold_n: {command.force_threshold_n:g} N leaves no way to stop before the cap of "
            f"{limits.cap_n:g} N; {AXIAL_SHARE * limits.cap_n:.3g} N is the most",
        )
    return _slowed(
        command,
        {
            "speed_m_s": limits.contact_speed_m_s(command.force_threshold_n),
            "creep_speed_m_s": min(limits.creep_speed_m_s(), limits.contact_speed_m_s(command.force_threshold_n)),
        },
    )


def judged_admittance(
    command: AdmittanceMove, limits: TouchingLimits, path_m_s: float
) -> tuple[AdmittanceMove, list[str]]:
    """The command with speeds that keep it under the cap, and what was slowed. Raises CommandRefused cap.

    `path_m_s` is the fastest speed of its search path, as `path_stretch` lets it be.
    """
    if command.axial_force_n > AXIAL_SHARE * limits.cap_n:
        raise CommandRefused(
            "cap",
            f"axial_force_n: {command.axial_force_n:g} N leaves no way to stop before the cap of {limits.cap_n:g} N; "
            f"{AXIAL_SHARE * limits.cap_n:.3g} N is the most",
        )
    allowed = limits.contact_speed_m_s(command.axial_force_n)
    along = float(np.sqrt(max(allowed**2 - path_m_s**2, (0.05 * allowed) ** 2)))
    return _slowed(
        command,
        {
            "speed_m_s": along,
            "lateral_speed_limit_m_s": limits.creep_speed_m_s(),
            # of the tip about the centre of yielding, some 0.1 m away at the most
            "rotational_speed_limit_rad_s": limits.creep_speed_m_s() / 0.05,
        },
    )


def path_stretch(path_m_s: float, axial_force_n: float, limits: TouchingLimits) -> float:
    """The factor, at least 1, by which a search path must take longer so that it may touch on its way."""
    return max(1.0, path_m_s / (PATH_SHARE * limits.contact_speed_m_s(min(axial_force_n, AXIAL_SHARE * limits.cap_n))))


def _slowed(command: CommandT, most: dict[str, float]) -> tuple[CommandT, list[str]]:
    notes, changes = [], {}
    for name, limit in most.items():
        asked = float(getattr(command, name))
        if asked > limit:
            changes[name] = limit
            notes.append(f"{name} slowed from {asked:.4g} to {limit:.4g}: more could press beyond the cap")
    return command.model_copy(update=changes), notes
