"""A plain plate on black, matt and without marks, as the simulated cell had it before its looks were drawn by the seed.

What is asked of a method on pictures that hold nothing but a hole, light, noise and one fault is asked on these.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from services.hardware.drivers.simulated.scene.scene_appearance import Appearance

# the same as a cell's setting `hardware.simulated.camera`
PLAIN_CAMERA: dict[str, Any] = {
    "blur_px": 0.7,
    "noise_grey": 3.0,
    "appearance": {
        "finish": "matt", "finish_strength": 0.0, "shine": 0.0, "face_gradient": 0.0, "edge_glints": 0.0,
        "face_glints": 0, "background": "dark", "hole": "through",
    },
}  # fmt: skip


def plain_look(rng: np.random.Generator) -> Appearance:
    """Greys and light drawn as they were."""
    sideways, upwards = rng.uniform(-0.9, 0.9), rng.uniform(-0.3, 1.0)
    to_light = np.array([-1.0, sideways, upwards])
    face = rng.uniform(0.7, 1.0)
    return Appearance(
        face_grey=face,
        bore_grey=face * rng.uniform(0.35, 0.85),
        background_grey=rng.uniform(0.05, 0.2),
        to_light=to_light / np.linalg.norm(to_light),
        ambient=rng.uniform(0.15, 0.3),
        diffuse=rng.uniform(0.5, 0.65),
        gradient=(rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1)),
    )
