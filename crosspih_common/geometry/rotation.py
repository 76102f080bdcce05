"""SciPy's rotations, loaded when the first one is made.

They bring half of SciPy with them, which takes longer than all else that the messages and keys need: whoever only names
a key, or prints the table of them, need not wait for it.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


@cache
def rotations() -> type[Rotation]:
    """`scipy.spatial.transform.Rotation`."""
    from scipy.spatial.transform import Rotation

    return Rotation
