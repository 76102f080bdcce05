"""Draw docs/cell.png: the simulated cell with its arm at home. Run from the project's root:

.venv/bin/python docs/make_cell_picture.py
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from crosspih_common.config import Workcell
from services.hardware.drivers.simulated.scene.camera import SimulatedScene


def main() -> None:
    """Render from above the robot's right shoulder."""
    workcell = Workcell()
    with SimulatedScene(workcell.hole.shape(workcell.peg.shape())) as scene:
        picture = scene.render_overview(
            workcell.hole_prior.pose_base_hole(),
            np.asarray(workcell.home_joints_rad),
            eye_m=(-0.05, -0.95, 0.75),
            target_m=(0.22, -0.18, 0.22),
        )
    cv2.imwrite(str(Path(__file__).with_name("cell.png")), picture[..., ::-1])


if __name__ == "__main__":
    main()
