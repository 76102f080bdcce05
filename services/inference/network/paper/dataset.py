"""Contact samples for training the network, and their split by pose."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crosspih_common.datasets import ContactTable, read_contacts
from crosspih_common.geometry.pose import Array


@dataclass(frozen=True, slots=True, eq=False)
class ContactDataset:
    """n contacts: wrench (n, 6) on the peg in the peg frame, N and Nm; angles_rad (n, 3) = (alpha, beta, gamma) of the
    hole in the peg frame; translation_m (n, 3) of the hole's rim against the aligned peg's; state (n,), "1-2-2" and
    so on; pose (n,): equal for repeats of one pose (if missing, each contact is a pose of its own)."""

    wrench: Array
    angles_rad: Array
    translation_m: Array
    state: NDArray[np.str_]
    pose: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        n = len(self.wrench)
        if self.pose is None:
            object.__setattr__(self, "pose", np.arange(n))
        shapes = (
            ("wrench", (n, 6)),
            ("angles_rad", (n, 3)),
            ("translation_m", (n, 3)),
            ("state", (n,)),
            ("pose", (n,)),
        )
        for name, shape in shapes:
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(f"ContactDataset.{name} wants shape {shape}, got {np.shape(getattr(self, name))}")

    def __len__(self) -> int:
        return len(self.wrench)

    def rows(self, index: NDArray[np.int64]) -> ContactDataset:
        """Some of the contacts."""
        assert self.pose is not None
        return ContactDataset(
            self.wrench[index], self.angles_rad[index], self.translation_m[index], self.state[index], self.pose[index]
        )

    def sha256(self) -> str:
        """A hash of the columns, independent of the file around them."""
        digest = hashlib.sha256()
        for column in (self.wrench, self.angles_rad, self.translation_m):
            digest.update(np.ascontiguousarray(column, dtype="<f8").tobytes())
        digest.update("\n".join(self.state.tolist()).encode())
        return digest.hexdigest()

    @classmethod
    def of(cls, table: ContactTable) -> ContactDataset:
        """The rows of a table in which something was touched."""
        touched = table.touched()
        return cls(
            touched.numbers("wrench"),
            touched.numbers("angles_rad"),
            touched.numbers("translation_m"),
            touched.strings("state", "none"),
            touched.integers("pose_seed"),
        )

    @classmethod
    def load(cls, path: Path) -> ContactDataset:
        """From a data set's folder. Raises DatasetError."""
        return cls.of(read_contacts(path))


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Training, validation and test rows; no pose is in two of them."""

    training: ContactDataset
    validation: ContactDataset
    test: ContactDataset


def split_by_pose(
    dataset: ContactDataset, seed: int, validation_share: float = 0.15, test_share: float = 0.15
) -> Split:
    """Split at random by pose, so that repeats of a pose stay in one part. Raises ValueError if a part would be
    empty."""
    assert dataset.pose is not None
    poses = np.unique(dataset.pose)
    shuffled = np.random.default_rng([seed, 0x5911]).permutation(poses)
    tested, validated = round(test_share * len(poses)), round(validation_share * len(poses))
    if min(tested, validated, len(poses) - tested - validated) < 1:
        raise ValueError(f"{len(poses)} poses are too few to split into training, validation and test")
    parts = np.split(shuffled, [tested, tested + validated])
    test, validation, training = (
        dataset.rows(np.flatnonzero(np.isin(dataset.pose, part)).astype(np.int64)) for part in parts
    )
    return Split(training, validation, test)
