"""The alternative to a rim with a chamfer: a shaded print with both lines drawn in the face's plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from services.vision.fit.climb import misfit
from services.vision.fit.rim import Rim
from services.vision.fit.solve import Doubts, Fit, Images, Look, State, iterate, look
from services.vision.stereo import StereoModel

STEPS = 3


def deeper_by(images: Images, rim: Rim, stereo: StereoModel, fit: Fit, doubts: Doubts) -> float:
    """Log likelihood ratio of a chamfer that goes down against one drawn in the face's plane. Below 0 the drawn one is
    more likely."""
    flat = rim.inner_m.copy()
    flat[..., 2] = 0.0
    state = replace(fit.state, profile_weight=None)
    drawn = _settled(images, replace(rim, inner_m=flat), stereo, state, doubts)
    down = _settled(images, rim, stereo, state, doubts)
    pixels = float(down.profiles.inside.sum()) * 0.5
    return (misfit(drawn, down.even) - misfit(down, down.even)) * pixels * float(np.mean(down.weight > 0.0))


def _settled(images: Images, rim: Rim, stereo: StereoModel, state: State, doubts: Doubts) -> Look:
    for _ in range(STEPS - 1):
        state, _ = iterate(images, rim, stereo, state, doubts)
    return look(images, rim, stereo, state)
