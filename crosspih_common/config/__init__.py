"""One YAML file a cell: the facts every service shares, and a section for each service."""

from crosspih_common.config.arm import ArmSection
from crosspih_common.config.camera import CameraSection
from crosspih_common.config.cell import CellFile, cell_of_text, load_cell, with_files_beside
from crosspih_common.config.drawing import HoleDrawing, HoleTolerance, PegDrawing
from crosspih_common.config.force_torque import Reports, SensorSection, with_correction_moved
from crosspih_common.config.placement import Placement
from crosspih_common.config.section import Section
from crosspih_common.config.surroundings import Surroundings
from crosspih_common.config.workcell import HolePrior, Workcell

__all__ = [
    "ArmSection",
    "CameraSection",
    "CellFile",
    "HoleDrawing",
    "HolePrior",
    "HoleTolerance",
    "PegDrawing",
    "Placement",
    "Reports",
    "Section",
    "SensorSection",
    "Surroundings",
    "Workcell",
    "cell_of_text",
    "load_cell",
    "with_correction_moved",
    "with_files_beside",
]
