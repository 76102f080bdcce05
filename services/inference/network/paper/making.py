"""Contacts from the mechanics into a data set's folder."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.config import Workcell, load_cell
from crosspih_common.datasets import ContactRow, ContactWriter, DatasetOrigin
from crosspih_common.messages import floats
from crosspih_common.modules import DEFAULT_CELL
from crosspih_common.provenance import code_version, with_file_contents
from services.inference.network.paper.dataset import ContactDataset
from services.inference.network.paper.synthesis import single_contact_dataset

Tell = Callable[[str, int, int], None]
# a row's random draw depends on its seed alone, so that a data set can be extended
SEEDS_A_BLOCK = 1000
_BLOCK_KEY = 0xC0


def workcell() -> Workcell:
    """The cell of CROSSPIH_CELL, or the default one."""
    return load_cell(os.environ.get("CROSSPIH_CELL") or DEFAULT_CELL).workcell


def drawn_contacts(cell: Workcell, block: int, settings: dict[str, float]) -> ContactDataset:
    """The contacts of the seeds from block * SEEDS_A_BLOCK on."""
    peg = cell.peg.shape()
    return single_contact_dataset(
        peg,
        cell.hole.shape(peg),
        SEEDS_A_BLOCK,
        np.random.default_rng([block, _BLOCK_KEY]),
        half_range_rad=settings["angle_rad"],
        half_range_m=settings["lateral_m"],
        force_n=settings["force_n"],
        friction_coefficient=settings["friction"],
        noise_sd=(settings["force_sd_n"], settings["moment_sd_nm"]),
    )


def make_contacts(out: Path, poses: int, seed: int, settings: dict[str, float], tell: Tell) -> dict[str, Any]:
    """Write single contacts of the mechanics into a data set's folder; existing rows are kept."""
    cell = workcell()
    shown = " ".join(f"--{name.replace('_', '-')} {value:g}" for name, value in settings.items())
    origin = DatasetOrigin(
        made_by="mechanics",
        command=f"crosspih dataset synthesise --poses {poses} --seed {seed} {shown}",
        first_seed=seed,
        poses=poses,
        cell_sha256=_shapes_sha256(cell),
        settings=settings,
        code=code_version(),
        version=_version(),
    )
    noise_sd = floats(np.repeat([settings["force_sd_n"], settings["moment_sd_nm"]], 3))
    with ContactWriter(out, origin) as writer:
        wanted = [one for one in range(seed, seed + poses) if one not in writer.done]
        kept = poses - len(wanted)
        blocks = sorted({one // SEEDS_A_BLOCK for one in wanted})
        for number, block in enumerate(blocks):
            drawn = drawn_contacts(cell, block, settings)
            rows = [one - block * SEEDS_A_BLOCK for one in wanted if one // SEEDS_A_BLOCK == block]
            writer.put([_row(drawn, row, block * SEEDS_A_BLOCK + row, noise_sd) for row in rows])
            tell("making contacts", number + 1, len(blocks))
    return {"folder": str(out), "made": len(wanted), "kept": kept}


def _row(drawn: ContactDataset, row: int, seed: int, noise_sd: tuple[float, ...]) -> ContactRow:
    wrench = drawn.wrench[row]
    return ContactRow(
        seed=seed,
        pose_seed=seed,
        angles_rad=floats(drawn.angles_rad[row]),
        translation_m=floats(drawn.translation_m[row]),
        wrench=floats(wrench),
        wrench_sd=noise_sd,
        state=str(drawn.state[row]),
        state_confidence=1.0,
        n_z0=float(abs(wrench[2]) / np.linalg.norm(wrench[:3])),
    )


def _shapes_sha256(cell: Workcell) -> str:
    # manufacturing accuracy of the hole is no part of its shape; a drawing counts by its content
    peg, hole = cell.peg.model_dump(mode="json"), cell.hole.model_dump(mode="json", exclude={"tolerance"})
    text = json.dumps(with_file_contents({"peg": peg, "hole": hole}), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _version() -> str:
    try:
        return metadata.version("crosspih")
    except metadata.PackageNotFoundError:
        return ""
