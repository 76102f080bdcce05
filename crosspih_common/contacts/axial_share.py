"""n_z0 of pushes of equal force (Eq. 17), without and with friction."""

from __future__ import annotations

from math import atan, hypot, sqrt, tan

# The lateral force of equal unit pushes on 1, 2 or 3 arms; on four it cancels.
_LATERAL = {1: 1.0, 2: sqrt(2.0), 3: 1.0}


def with_friction(n_z0: float, count: int, friction: float) -> float:
    """n_z0 of the same 1 to 4 contacts with friction: each push leans back by the friction angle and the taper's."""
    if count == 4 or friction == 0.0 or n_z0 >= 1.0:
        return n_z0
    lateral = _LATERAL[count]
    share = n_z0 * lateral / (count * sqrt(1.0 - n_z0**2))
    leaning = count * tan(min(atan(share) + atan(friction), 1.5))
    return leaning / hypot(leaning, lateral)
