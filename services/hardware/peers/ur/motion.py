"""What a program's motion functions do to the set-points of the joints.

`servoj` as the script manual describes it: the target is approached as by a P controller of `gain`, from where the
joints will be after `lookahead_time` at their present speed. That is a second-order system, which follows a moving
target `lookahead_time` behind it. The maker's own code is not published.
"""

from __future__ import annotations

import numpy as np

from crosspih_common.geometry.pose import Array

SPEED_RAD_S = np.pi
ACCELERATION_RAD_S2 = 40.0
HALT_RAD_S2 = 15.0


class SetPoints:
    """Where the joints (6,) are told to be, rad, and how fast, rad/s; one mode at a time."""

    def __init__(self, joints_rad: Array, period_s: float) -> None:
        self.period_s = period_s
        self._target: Array | None = None
        self.restart(joints_rad)

    def restart(self, joints_rad: Array) -> None:
        """At rest there."""
        self.joints_rad, self.speeds_rad_s = np.array(joints_rad, float), np.zeros(6)
        self.halt()

    def servo(self, target_rad: Array, lookahead_s: float, gain: float) -> None:
        """Follow a target. Raises ValueError where a number is out of the manual's range."""
        target = np.asarray(target_rad, float)
        if target.shape != (6,) or not np.all(np.isfinite(target)):
            raise ValueError(f"servoj wants six joint angles, got {target_rad}")
        if not (0.03 <= lookahead_s <= 0.2 and 100.0 <= gain <= 2000.0):
            raise ValueError(f"servoj: lookahead_time {lookahead_s} (0.03 to 0.2), gain {gain} (100 to 2000)")
        self._target, self._lookahead_s, self._gain = target, lookahead_s, gain

    def halt(self, slower_rad_s2: float = HALT_RAD_S2) -> None:
        """Slow down to rest, every joint by so much."""
        self._target = None
        self._slower_rad_s2 = abs(slower_rad_s2)

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves."""
        return bool(np.all(np.abs(self.speeds_rad_s) < 1e-9))

    def advance(self) -> None:
        """One cycle."""
        if self._target is not None:
            ahead = self.joints_rad + self._lookahead_s * self.speeds_rad_s
            change = np.clip(self._gain * (self._target - ahead), -ACCELERATION_RAD_S2, ACCELERATION_RAD_S2)
            speeds = np.clip(self.speeds_rad_s + change * self.period_s, -SPEED_RAD_S, SPEED_RAD_S)
        else:
            less = self._slower_rad_s2 * self.period_s
            speeds = np.sign(self.speeds_rad_s) * np.maximum(0.0, np.abs(self.speeds_rad_s) - less)
        self.speeds_rad_s = speeds
        self.joints_rad = self.joints_rad + speeds * self.period_s
