"""An outline from a drawing file: SVG or DXF."""

from __future__ import annotations

from pathlib import Path

from crosspih_common.shapes.outline import Outline

FILE_SUFFIXES = (".svg", ".dxf")


def outline_from_file(path: Path) -> Outline:
    """The one closed outline in a file, centred, metres. Raises ValueError naming the file, the entity and the mend."""
    raise ValueError(f"{path}: not yet")
