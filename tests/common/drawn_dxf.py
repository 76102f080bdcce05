"""A DXF that a test draws, and what is read of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ezdxf.document import Drawing

from crosspih_common.shapes.importing import DrawingRead, read_drawing


def dxf(folder: Path, draw: Callable[[Drawing], object], unit: int = 4) -> DrawingRead:
    document = Drawing.new()
    document.units = unit
    draw(document)
    path = folder / "drawn.dxf"
    document.saveas(path)
    return read_drawing(path)
