"""One YAML file a cell: the facts every service shares, and a section for each service."""

from crosspih_common.config.cell import CellFile, load_cell
from crosspih_common.config.drawing import HoleDrawing, PegDrawing
from crosspih_common.config.placement import Placement
from crosspih_common.config.section import Section
from crosspih_common.config.surroundings import Surroundings
from crosspih_common.config.workcell import HolePrior, Workcell

__all__ = [
    "CellFile",
    "HoleDrawing",
    "HolePrior",
    "PegDrawing",
    "Placement",
    "Section",
    "Surroundings",
    "Workcell",
    "load_cell",
]
