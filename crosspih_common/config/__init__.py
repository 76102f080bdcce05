"""One YAML file a cell: the facts every service shares, and a section for each service."""

from __future__ import annotations

from typing import TYPE_CHECKING

from crosspih_common.modules import on_demand

if TYPE_CHECKING:
    from crosspih_common.config.arm import ArmSection
    from crosspih_common.config.camera import CameraSection
    from crosspih_common.config.cell import CellFile, cell_of_text, load_cell, with_files_beside
    from crosspih_common.config.drawing import HoleDrawing, HoleTolerance, PegDrawing
    from crosspih_common.config.force_torque import Reports, SensorSection, with_correction_moved
    from crosspih_common.config.name import cell_name
    from crosspih_common.config.placement import Placement
    from crosspih_common.config.section import Section
    from crosspih_common.config.surroundings import Surroundings
    from crosspih_common.config.workcell import HolePrior, Workcell
else:
    _MODULES = {
        "ArmSection": "arm",
        "CameraSection": "camera",
        "CellFile": "cell",
        "HoleDrawing": "drawing",
        "HolePrior": "workcell",
        "HoleTolerance": "drawing",
        "PegDrawing": "drawing",
        "Placement": "placement",
        "Reports": "force_torque",
        "Section": "section",
        "SensorSection": "force_torque",
        "Surroundings": "surroundings",
        "Workcell": "workcell",
        "cell_name": "name",
        "cell_of_text": "cell",
        "load_cell": "cell",
        "with_correction_moved": "force_torque",
        "with_files_beside": "cell",
    }
    __getattr__ = on_demand(__name__, _MODULES)  # reading only a cell's name loads neither shapes nor arms


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
    "cell_name",
    "cell_of_text",
    "load_cell",
    "with_correction_moved",
    "with_files_beside",
]
