"""How long kinematics take: `python -m tests.arm.measure_inverse`. Not a test: nothing is asserted of time."""

from __future__ import annotations

import timeit
from collections.abc import Callable

import numpy as np

from crosspih_common.arm import NAMED_ARMS, named_arm
from crosspih_common.arm.inverse import nearest
from crosspih_common.geometry import Pose


def microseconds(work: Callable[[], object]) -> float:
    """The best of five means of 1000 calls."""
    return min(timeit.repeat(work, number=1000, repeat=5)) * 1e3


def main() -> None:
    for name, named in NAMED_ARMS.items():
        arm, home = named_arm(name), np.array(named.home_rad)
        pose = arm.pose_base_flange(home) @ Pose.from_translation([1e-3, 0.0, 0.0])
        figures = {
            "flange": microseconds(lambda arm=arm, home=home: arm.pose_base_flange(home)),  # type: ignore[misc]
            "Jacobian": microseconds(lambda arm=arm, home=home: arm.jacobian(home)),  # type: ignore[misc]
            "inverse, 1 mm away": microseconds(lambda arm=arm, home=home, pose=pose: nearest(arm, pose, home)),  # type: ignore[misc]
        }
        print(name, ", ".join(f"{what} {value:.0f} us" for what, value in figures.items()))


if __name__ == "__main__":
    main()
