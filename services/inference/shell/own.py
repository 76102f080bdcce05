"""A user's own estimator and network, loaded as the cell's file says (crosspih_common/estimator.py)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from crosspih_common.config import Workcell
from crosspih_common.errors import CommandRefused, ConfigError
from crosspih_common.estimator import TouchesToPose, WrenchToPose
from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import PosePrior, Touch
from crosspih_common.own_code import load

ResultT = TypeVar("ResultT")


class OwnEstimator:
    """From touches to a pose by a user's own function. Raises ConfigError if it cannot be loaded."""

    def __init__(self, name: str, workcell: Workcell) -> None:
        self.name, self._workcell = name, workcell
        self._estimate: TouchesToPose = _callable("inference.estimator", name)

    def __call__(self, prior: PosePrior, touches: Sequence[Touch]) -> PosePrior:
        """The hole in the base frame. Raises CommandRefused `own_code`."""
        return _answer(self.name, PosePrior, lambda: self._estimate(prior, touches, self._workcell))


class OwnNetwork:
    """From a wrench to a pose by a user's own function. Raises ConfigError if it cannot be loaded."""

    def __init__(self, name: str, workcell: Workcell) -> None:
        self.name, self._workcell = name, workcell
        self._predict: WrenchToPose = _callable("inference.network", name)

    def pose_peg_hole(self, wrench: Array, pose_peg_hole: Pose) -> Pose:
        """The hole in the peg frame. Raises CommandRefused `own_code`."""
        found = _answer(self.name, Pose, lambda: self._predict(wrench, pose_peg_hole, self._workcell))
        if not np.isfinite(found.matrix()).all():
            raise CommandRefused("own_code", f"{self.name}: answered a pose that is not finite")
        return found


def _callable(setting: str, name: str) -> Callable[..., ResultT]:
    found: Callable[..., ResultT] = load(setting, name)
    if not callable(found):
        raise ConfigError(f"{setting} {name}: is no function (crosspih_common/estimator.py)")
    return found


def _answer(name: str, kind: type[ResultT], ask: Callable[[], object]) -> ResultT:
    try:
        found = ask()
    except Exception as error:  # whatever the user's function raises
        raise CommandRefused("own_code", f"{name}: {type(error).__name__}: {error}") from error
    if not isinstance(found, kind):
        raise CommandRefused("own_code", f"{name}: answered {type(found).__name__}, want {kind.__name__}")
    return found
