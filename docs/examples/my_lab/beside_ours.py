"""An estimator of one's own beside ours on the same recorded touches, against the simulator's truth.

PYTHONPATH=docs/examples python -m my_lab.beside_ours recordings/assembly-fused-seed7-0001.mcap
"""

from __future__ import annotations

import sys
from pathlib import Path

from crosspih_common.client import Recording
from crosspih_common.config import Workcell
from crosspih_common.keys import ESTIMATE, TRUTH
from my_lab.fit import estimate


def errors_mm(recording: Recording, workcell: Workcell) -> list[tuple[int, float, float]]:
    """(touches, ours, own) for each estimate on the way in: how far across its axis each has the hole off, mm."""
    truth = recording.last(TRUTH)
    assert truth is not None, "only a simulated cell knows where the hole is"
    true_hole = truth.pose_base_hole.pose()

    def off_mm(pose: object) -> float:
        x, y, _ = (true_hole.inverse() @ pose).translation_m  # type: ignore[operator]
        return float(x**2 + y**2) ** 0.5 * 1e3

    rows = []
    for asked, ours in recording.answered(ESTIMATE):
        request = asked.value
        if ours is None or all(touch.seated for touch in request.touches):
            continue
        own = estimate(request.prior, request.touches, workcell)
        rows.append((len(request.touches), off_mm(ours.value.pose_base_hole.pose()), off_mm(own.pose_base_hole.pose())))
    return rows


if __name__ == "__main__":
    print("touches  ours/mm  own/mm")
    for touches, ours_mm, own_mm in errors_mm(Recording(Path(sys.argv[1])), Workcell()):
        print(f"{touches:7d}  {ours_mm:7.3f}  {own_mm:6.3f}")
