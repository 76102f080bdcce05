"""What `python -m services.inference.network` does, each command as a function that returns its result."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from crosspih_common.config import Workcell, load_cell
from crosspih_common.datasets import ContactRow, ContactWriter, DatasetOrigin, read_contacts
from crosspih_common.geometry.pose import Array
from crosspih_common.messages import floats
from crosspih_common.service.lifecycle import DEFAULT_CELL
from services.inference.network.dataset import ContactDataset, split_by_pose
from services.inference.network.paper_rows import paper_rows
from services.inference.network.synthesis import single_contact_dataset
from services.inference.network.training import TrainingSettings, train

Tell = Callable[[str, int, int], None]
# a row's draw depends on its seed alone, so that a data set can be gone on with
SEEDS_A_BLOCK = 1000
# the first weights decide much of what ten rows teach
LEAVE_ONE_OUT_NETWORKS = 8
_BLOCK_KEY = 0xC0


def workcell() -> Workcell:
    """The cell of CROSSPIH_CELL, or the default one."""
    return load_cell(os.environ.get("CROSSPIH_CELL") or DEFAULT_CELL).workcell


def _drawn(cell: Workcell, block: int, settings: dict[str, float]) -> ContactDataset:
    """The contacts of the seeds block * SEEDS_A_BLOCK and on."""
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
    """Single contacts from the mechanics into a data set's folder; what is there is kept."""
    cell = workcell()
    shown = " ".join(f"--{name.replace('_', '-')} {value:g}" for name, value in settings.items())
    origin = DatasetOrigin(
        made_by="mechanics",
        command=f"crosspih dataset synthesise --poses {poses} --seed {seed} {shown}",
        first_seed=seed,
        poses=poses,
        cell_sha256=_shapes_sha256(cell),
        settings=settings,
        version=_version(),
    )
    noise_sd = floats(np.repeat([settings["force_sd_n"], settings["moment_sd_nm"]], 3))
    with ContactWriter(out, origin) as writer:
        wanted = [one for one in range(seed, seed + poses) if one not in writer.done]
        kept = poses - len(wanted)
        blocks = sorted({one // SEEDS_A_BLOCK for one in wanted})
        for number, block in enumerate(blocks):
            drawn = _drawn(cell, block, settings)
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
    import hashlib

    return hashlib.sha256((cell.peg.model_dump_json() + cell.hole.model_dump_json()).encode()).hexdigest()


def _version() -> str:
    try:
        return metadata.version("crosspih")
    except metadata.PackageNotFoundError:
        return ""


def train_on_table(
    data: Path, out: Path | None, seed: int, settings: TrainingSettings, command: str, floor_contacts: int, tell: Tell
) -> dict[str, Any]:
    """Train the paper's network on a data set split by pose, and judge it; the weights go to `out`."""
    from services.inference.network import evaluation

    table = read_contacts(data)
    split = split_by_pose(ContactDataset.of(table), seed)

    def on_epoch(epoch: int, training: float, validation: float | None) -> None:
        tell(f"{settings.optimiser.value}: error {validation or training:.5f}", epoch, settings.epochs)

    network, curves = train(
        split.training, seed, command, split.validation, settings, table.sha256(), table.origin.command, on_epoch
    )
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        network.save(out)
    origin = table.origin
    return {
        "record": dataclasses.asdict(network.record),
        "hidden": settings.hidden,
        "optimiser": settings.optimiser.value,
        "weights": "" if out is None else str(out),
        "data": {"folder": str(data), "samples": len(table), "contacts": len(table.touched()), **origin.model_dump()},
        "curves": evaluation.curves_of(curves),
        "parts": evaluation.judge(network, split),
        "states": evaluation.by_state(network, split.test),
        "floor": _floor(origin.settings, floor_contacts, tell),
        "known_floors_deg": evaluation.KNOWN_FLOORS_DEG,
    }


def _floor(drawn: dict[str, float], contacts: int, tell: Tell) -> dict[str, Any] | None:
    """The floor for a data set's own ranges: single contacts of the mechanics, without friction and noise."""
    from services.inference.network import evaluation

    blocks = contacts // SEEDS_A_BLOCK
    if blocks < 2:
        return None
    settings = {
        "angle_rad": drawn["angle_rad"], "lateral_m": drawn["lateral_m"], "force_n": 20.0, "friction": 0.0,
        "force_sd_n": 0.0, "moment_sd_nm": 0.0,
    }  # fmt: skip
    cell = workcell()
    made = []
    for block in range(blocks):
        # no seed of a data set is so large
        made.append(_drawn(cell, 10**9 + block, settings))
        tell("finding the floor", block + 1, blocks)
    asked = max(1, blocks // 10)

    def joined(parts: list[ContactDataset]) -> ContactDataset:
        def column(name: str) -> Array:
            return np.concatenate([getattr(part, name) for part in parts])

        return ContactDataset(
            column("wrench"), column("angles_rad"), column("translation_m"),
            np.concatenate([part.state for part in parts]),
        )  # fmt: skip

    return evaluation.synthetic_floor(joined(made[asked:]), joined(made[:asked]))


def train_on_paper_rows(settings: TrainingSettings, seed: int, tell: Tell) -> dict[str, Any]:
    """The ten printed rows: errors in the sample, as printed in the paper, and each row by the nine others."""
    from services.inference.network import evaluation

    dataset = paper_rows()
    network, curves = train(dataset, seed, "crosspih train --paper-rows", settings=settings)
    inside = network.predict(dataset.wrench)
    seeds = range(seed, seed + LEAVE_ONE_OUT_NETWORKS)
    predicted, means = evaluation.leave_one_out(
        dataset, seeds, settings, lambda done: tell("leaving one out", done, len(dataset))
    )
    off = np.degrees(predicted - dataset.angles_rad)
    of_each = np.sqrt(np.mean(off**2, axis=1))
    return {
        "record": dataclasses.asdict(network.record),
        "hidden": settings.hidden,
        "optimiser": settings.optimiser.value,
        "curves": evaluation.curves_of(curves),
        "in_sample": evaluation.figures(inside - dataset.angles_rad),
        "leave_one_out": evaluation.figures((predicted - dataset.angles_rad).reshape(-1, 3)),
        "leave_one_out_networks": len(seeds),
        "leave_one_out_rms_least_deg": np.round(of_each.min(axis=0), 4).tolist(),
        "leave_one_out_rms_most_deg": np.round(of_each.max(axis=0), 4).tolist(),
        "mean_of_the_others": evaluation.figures(means - dataset.angles_rad),
        "true_deg": np.round(np.degrees(dataset.angles_rad), 4).tolist(),
        "in_sample_deg": np.round(np.degrees(inside), 4).tolist(),
        "leave_one_out_deg": np.round(np.degrees(predicted[0]), 4).tolist(),
    }


def train_sequences(out: Path, sequences: int, touches: int, epochs: int, seed: int, tell: Tell) -> dict[str, Any]:
    """Make histories of touches, train the sequence network on them, and save it."""
    import torch

    from services.inference.network.sequence_data import touch_sequences
    from services.inference.network.sequence_model import SequenceTraining, train_sequence_network

    # more threads would sum in another order
    torch.set_num_threads(1)
    cell = workcell()
    peg = cell.peg.shape()
    dataset = touch_sequences(
        peg, cell.hole.shape(peg), sequences, touches, np.random.default_rng(seed),
        on_made=lambda made: tell("making histories", made, sequences),
    )  # fmt: skip
    command = (
        f"python -m services.inference.network sequence --sequences {sequences} --touches {touches} "
        f"--epochs {epochs} --seed {seed}"
    )
    network = train_sequence_network(
        peg, dataset, seed, command, SequenceTraining(epochs=epochs),
        on_epoch=lambda epoch, training, validation: tell(f"training: loss {validation:.3f}", epoch, epochs),
    )  # fmt: skip
    out.parent.mkdir(parents=True, exist_ok=True)
    network.save(out)
    return {"weights": str(out), **dataclasses.asdict(network.record)}


def compare_sequence_network(weights: Path | None, trials: int, touches: int, seed: int, tell: Tell) -> dict[str, Any]:
    """The sequence network and the estimator on the same touches; see `sequence_comparison`."""
    from services.inference.network.sequence_comparison import compare

    return compare(workcell(), weights, trials, touches, seed, tell)
