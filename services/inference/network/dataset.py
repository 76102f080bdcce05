"""Contact samples as plain columns in one npz file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crosspih_common.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class ContactDataset:
    """n contacts: wrench (n, 6) on the peg in the peg frame, N and Nm; angles_rad (n, 3) = (alpha, beta, gamma) of the
    hole in the peg frame; translation_m (n, 3) of the hole's rim against the aligned peg's; state (n,), "1-2-2" and
    so on."""

    wrench: Array
    angles_rad: Array
    translation_m: Array
    state: NDArray[np.str_]

    def __post_init__(self) -> None:
        n = len(self.wrench)
        for name, shape in (("wrench", (n, 6)), ("angles_rad", (n, 3)), ("translation_m", (n, 3)), ("state", (n,))):
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(f"ContactDataset.{name} wants shape {shape}, got {np.shape(getattr(self, name))}")

    def sha256(self) -> str:
        """A hash of the columns, independent of the file around them."""
        digest = hashlib.sha256()
        for column in (self.wrench, self.angles_rad, self.translation_m):
            digest.update(np.ascontiguousarray(column, dtype="<f8").tobytes())
        digest.update("\n".join(self.state.tolist()).encode())
        return digest.hexdigest()

    def save(self, path: Path) -> None:
        """Write an npz with the four columns."""
        np.savez_compressed(
            path,
            wrench=self.wrench,
            angles_rad=self.angles_rad,
            translation_m=self.translation_m,
            state=self.state,
        )

    @classmethod
    def load(cls, path: Path) -> ContactDataset:
        """Read what `save` wrote; ValueError names a column that is missing."""
        with np.load(path, allow_pickle=False) as columns:
            missing = {"wrench", "angles_rad", "translation_m", "state"} - set(columns.files)
            if missing:
                raise ValueError(f"{path} lacks the columns {sorted(missing)}: make the dataset anew")
            return cls(columns["wrench"], columns["angles_rad"], columns["translation_m"], columns["state"])
