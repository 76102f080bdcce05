"""SciPy's rotations, loaded when the first one is made.

They load half of SciPy, which takes longer than all other imports of the messages and keys. Code that only names a key,
or prints the key table, need not wait for it.
"""

from __future__ import annotations

import inspect
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


@cache
def rotations() -> type[Rotation]:
    """`scipy.spatial.transform.Rotation`."""
    from scipy.spatial.transform import Rotation

    return Rotation


@cache
def _unchecked() -> dict[str, bool]:
    known = "assume_valid" in inspect.signature(rotations().from_matrix).parameters
    return {"assume_valid": True} if known else {}


def rotation_of(matrix: NDArray[np.float64]) -> Rotation:
    """SciPy's rotation of a (3, 3) matrix that is proper orthonormal, as that of a Pose is.

    From SciPy 1.17 on the matrix is not checked again: the check takes most of the time (50 of 65 microseconds).
    """
    return rotations().from_matrix(matrix, **_unchecked())
