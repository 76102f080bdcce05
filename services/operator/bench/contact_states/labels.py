"""The true state of a contact: which arms touch, on which side, from the simulator's contact points alone."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from crosspih_common.contacts.arm_edges import ARM_DIRECTIONS
from crosspih_common.geometry.pose import Array

NONE = "none"
MIN_SHARE = 0.03
MIN_FORCE_N = 0.15
# A taper edge on a side rim pushes back with .2 to .5 of its sideways force, a chamfer or a face with 1 or more.
STEEPEST_SIDE = 0.7


@dataclass(frozen=True, slots=True)
class TrueState:
    """`name` as in Tables 2-5, or "none" with the reason; `touching`: the arm, the kind of touch and the force on it,
    N.

    Kinds: "side 1", "side 2" (taper on a side wall, by sense), "body 1", "body 2" (the body on it), "end" (the end of
    an arm on the end wall), "face" (the outer face, the chamfer or a corner on them).
    """

    name: str
    reason: str
    touching: tuple[tuple[int, str, float], ...]

    @property
    def arms(self) -> tuple[int, ...]:
        """The arms that touch, in ascending order."""
        return tuple(sorted({arm for arm, _, _ in self.touching}))


def label_contacts(points_peg_m: Array, forces_peg_n: Array, taper_start_m: float) -> TrueState:
    """The state of contact points (n, 3), m, with the forces there on the peg (n, 3), N, both in the peg frame."""
    felt: dict[tuple[int, str], Array] = defaultdict(lambda: np.zeros(3))
    for point, force in zip(np.reshape(points_peg_m, (-1, 3)), np.reshape(forces_peg_n, (-1, 3)), strict=True):
        arm = int(np.argmax(ARM_DIRECTIONS @ point))
        felt[arm + 1, _kind(arm, point, force, taper_start_m)] += force
    sizes = {key: float(np.linalg.norm(force)) for key, force in felt.items()}
    least = max(MIN_FORCE_N, MIN_SHARE * max(sizes.values(), default=0.0))
    touching = tuple((arm, kind, size) for (arm, kind), size in sorted(sizes.items()) if size >= least)
    name, reason = _named(touching)
    return TrueState(name, reason, touching)


def _kind(arm: int, point: Array, force: Array, taper_start_m: float) -> str:
    outward = ARM_DIRECTIONS[arm]
    sideways = float(np.cross([0.0, 0.0, 1.0], outward) @ force)
    radial, axial = float(outward @ force), float(force[2])
    if abs(axial) > STEEPEST_SIDE * max(abs(sideways), abs(radial)) and abs(radial) < abs(sideways):
        return "face"
    if abs(radial) >= abs(sideways):
        return "end" if abs(radial) > abs(axial) else "face"
    part = "body" if point[2] < taper_start_m - 1e-4 else "side"
    return f"{part} {1 if sideways < 0.0 else 2}"


def _named(touching: tuple[tuple[int, str, float], ...]) -> tuple[str, str]:
    if not touching:
        return NONE, "nothing touches"
    kinds = {kind for _, kind, _ in touching}
    if "face" in kinds:
        return NONE, "face or chamfer"
    if "end" in kinds:
        return NONE, "end of an arm"
    if any(kind.startswith("body") for kind in kinds):
        return NONE, "the body touches"
    if len(kinds) > 1:
        return NONE, "walls of both senses"
    arms = {arm for arm, _, _ in touching}
    if arms in ({1, 3}, {2, 4}):
        return NONE, "opposite arms"
    sense, count = int(next(iter(kinds))[-1]), len(arms)
    if count == 4:
        case = 1
    elif count == 3:
        case = ({1, 2, 3, 4} - arms).pop()
    elif count == 2:
        case = next(arm for arm in (1, 2, 3, 4) if arms == {arm, arm % 4 + 1})
    else:
        case = arms.copy().pop()
    return f"{count}-{sense}-{case}", ""
