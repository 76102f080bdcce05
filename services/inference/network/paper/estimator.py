"""The paper's correction as one call: a wrench to three angles by the network, then x, y and z by Eq. 24."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crosspih_common.geometry import Pose, rotation_from_error_angles
from crosspih_common.geometry.pose import Array
from crosspih_common.modules import ALL_PACKAGES
from crosspih_common.shapes import Hole, Peg
from services.inference.mechanics import PairTables
from services.inference.mechanics.translation import solve_translation
from services.inference.network.settings import PAPER_WEIGHTS

if TYPE_CHECKING:
    from services.inference.network.paper.model import AngleNetwork


class NetworkUnavailable(Exception):
    """The network's weights are missing or of another format; the message says how to make them."""


class NetworkEstimator:
    """The trained network with the peg and hole that its last step needs.

    weights: a safetensors file; empty: the shipped one. Raises `NetworkUnavailable` where there is none or torch is not
    installed. Torch and the file are loaded at the first wrench, because that takes a second or two and most assemblies
    never use the network.
    """

    def __init__(self, weights: str, peg: Peg, hole: Hole) -> None:
        self._path = Path(weights) if weights else PAPER_WEIGHTS
        if not self._path.is_file():
            raise NetworkUnavailable(f"no network weights at {self._path}: train some, or name their file in `weights`")
        if importlib.util.find_spec("torch") is None:
            raise NetworkUnavailable(f"torch is not installed: {ALL_PACKAGES}")
        self._network: AngleNetwork | None = None
        self._tables = PairTables.of(peg, hole)

    def _loaded(self) -> AngleNetwork:
        if self._network is None:
            try:
                from services.inference.network.paper.model import AngleNetwork
            except ImportError as error:
                raise NetworkUnavailable(f"torch cannot be loaded ({error}): {ALL_PACKAGES}") from error
            try:
                self._network = AngleNetwork.load(self._path)
            except Exception as error:
                raise NetworkUnavailable(f"{self._path} is not a network of ours ({error}): train it anew") from error
        return self._network

    def pose_peg_hole(self, wrench_peg: Array, believed_peg_hole: Pose) -> Pose:
        """The hole in the peg frame from one contact's wrench (6,); the belief only gives the start along z.

        Raises `NetworkUnavailable` if torch cannot be loaded or the file is no network of this kind.
        """
        angles = self._loaded().predict(np.asarray(wrench_peg, float))
        translation, _ = solve_translation(
            self._tables, angles, wrench_peg, rim_ahead_m=float(believed_peg_hole.translation_m[2])
        )
        return Pose(rotation_from_error_angles(angles), translation)
