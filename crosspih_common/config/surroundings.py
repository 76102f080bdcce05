"""The obstacles around the arm in a cell's file. The plate with the hole is not among them: it follows from the drawing
and the prior of the hole (`crosspih_common.collision.fixture`)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from crosspih_common.config.placement import Placement
from crosspih_common.config.section import Section

MESH_SUFFIXES = (".stl", ".obj", ".ply", ".dae")
FIXTURE, STAND, FLOOR = "the fixture", "the fixture's stand", "the floor"

Length = Annotated[float, Field(gt=0.0)]


class Standing(Placement):
    """A named obstacle, placed in the base frame."""

    name: str = Field(min_length=1, max_length=40, description="as errors call it")


class Box(Standing):
    """A box about its own origin; `size_m` are its whole lengths along its x, y and z."""

    size_m: tuple[Length, Length, Length]


class Cylinder(Standing):
    """A cylinder about its own origin, its axis its z; `length_m` is the whole of it."""

    radius_m: Length
    length_m: Length


class Mesh(Standing):
    """A mesh from a file; its path is relative to the folder of the cell's file.

    Checks use its convex hull. With `hull: false` they use its triangles, so that the arm may reach into hollows; this
    is a hundred times slower, and a link that is wholly inside is not noticed.
    """

    file: str = Field(min_length=1)
    scale: float = Field(default=1.0, gt=0.0, description="metres a unit of the file: 0.001 for millimetres")
    hull: bool = True

    @model_validator(mode="after")
    def _can_be_read(self) -> Mesh:
        if Path(self.file).suffix.lower() not in MESH_SUFFIXES:
            raise ValueError(f"file {self.file!r}: want a mesh that ends in {', '.join(MESH_SUFFIXES)}")
        return self


class Surroundings(Section):
    """The obstacles that the arm stays clear of; metres, base frame.

    The arm keeps the distance `margin_m` from everything here; a `keep_out` box may be empty space. The peg and its
    tool may come near the fixture only, and only where the hole can be (`crosspih_common.collision`).
    """

    boxes: tuple[Box, ...] = ()
    cylinders: tuple[Cylinder, ...] = ()
    meshes: tuple[Mesh, ...] = ()
    keep_out: tuple[Box, ...] = ()
    floor_height_m: float | None = Field(
        default=0.05,
        description="of the floor, and what lies on it, above the base's origin, against gravity; null: there is none",
    )
    stand_radius_m: Length | None = Field(
        default=0.045, description="of what carries the plate, from its lower edge to the floor; null: nothing does"
    )
    tool_radius_m: float = Field(default=0.035, gt=0.0, description="of all between flange and peg, about their line")
    margin_m: float = Field(default=0.015, ge=0.002, le=0.2, description="the least distance of a free move")

    @model_validator(mode="after")
    def _names_tell_apart(self) -> Surroundings:
        taken = {FIXTURE, STAND, FLOOR}
        for field in ("boxes", "cylinders", "meshes", "keep_out"):
            for index, thing in enumerate(getattr(self, field)):
                if thing.name in taken:
                    raise ValueError(f"{field}.{index}.name {thing.name!r} is taken; give it a name of its own")
                taken.add(thing.name)
        return self


def with_mesh_files_beside(path: Path, cell: dict[str, Any]) -> dict[str, Any]:
    """The raw section `cell` of the file at `path`; mesh paths in it are resolved from the folder of that file."""
    surroundings = cell.get("surroundings")
    if not isinstance(surroundings, dict) or not isinstance(meshes := surroundings.get("meshes"), list):
        return cell
    found = [
        {**mesh, "file": str(path.parent / mesh["file"])}
        if isinstance(mesh, dict) and isinstance(mesh.get("file"), str)
        else mesh
        for mesh in meshes
    ]
    return {**cell, "surroundings": {**surroundings, "meshes": found}}
