"""The score of the AI for Industry Challenge, adapted to this assembly. Pure.

The challenge (Intrinsic and Open Robotics 2026; intrinsic-dev/aic, docs/scoring.md at commit db40abc) gives a cable
insertion up to 100 points. Kept as it is:

- validity 1: the system ran; 0 where a service was lost or refused
- insertion 75: the peg is in, by the simulator's truth
- duration 12 at 5 s or less, falling linearly to 0 at 60 s
- smoothness 6 at no jerk, falling linearly to 0 at 50 m/s^3: the mean of the tip's |jerk| while it moves faster than
  10 mm/s
- path 6 where the tip's way is no longer than the straight line from start to hole, falling linearly to 0 at 1 m more
- force -12 where the contact force was above 20 N for more than 1 s in all

Adapted:

- the duration is motion and thinking, from the start of the assembly at the home position until the pose is reported,
  the presses for the exact pose included
- the tip's way is the motor side's; deflection is not in it
- duration, smoothness and path count for an inserted peg alone, and there are no points for being near: an assembly
  that fails ends with its peg backed off, so that where it ends says nothing about how near it came
- nothing is off limits in this cell and there is one hole, so that those two penalties cannot occur
"""

from __future__ import annotations

from dataclasses import dataclass

from crosspih_common.messages import Failure

MAX_SCORE = 100.0
INVALID = (Failure.SERVICE_LOST.value, Failure.REFUSED.value, Failure.NOT_CALIBRATED.value)
INSERTION, DURATION, SMOOTHNESS, PATH, FORCE, VALIDITY = 75.0, 12.0, 6.0, 6.0, -12.0, 1.0
FAST_S, SLOW_S = 5.0, 60.0
JERKY_M_S3 = 50.0
DETOUR_M = 1.0
HEAVY_S = 1.0


@dataclass(frozen=True, slots=True)
class ChallengeScore:
    """The parts of a trial's score, in points."""

    validity: float
    insertion: float
    duration: float
    smoothness: float
    path: float
    force: float

    @property
    def total(self) -> float:
        """All parts together."""
        return self.validity + self.insertion + self.duration + self.smoothness + self.path + self.force


def challenge_score(
    *,
    inserted: bool,
    failure: str | None,
    duration_s: float,
    mean_jerk_m_s3: float,
    tip_path_m: float,
    start_distance_m: float,
    over_20_n_s: float,
) -> ChallengeScore:
    """A trial's points; `start_distance_m` is from the tip at the start to the hole."""

    def share(value: float, best: float, worst: float) -> float:
        return min(1.0, max(0.0, (worst - value) / (worst - best)))

    detour_m = tip_path_m - start_distance_m
    return ChallengeScore(
        validity=0.0 if failure in INVALID else VALIDITY,
        insertion=INSERTION if inserted else 0.0,
        duration=DURATION * share(duration_s, FAST_S, SLOW_S) if inserted else 0.0,
        smoothness=SMOOTHNESS * share(mean_jerk_m_s3, 0.0, JERKY_M_S3) if inserted else 0.0,
        path=PATH * share(detour_m, 0.0, DETOUR_M) if inserted else 0.0,
        force=FORCE if over_20_n_s > HEAVY_S else 0.0,
    )
