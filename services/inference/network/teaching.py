"""Trains and evaluates the networks for `python -m services.inference.network`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import torch

from crosspih_common.datasets import read_contacts
from crosspih_common.geometry.pose import Array
from services.inference.network.paper import evaluation
from services.inference.network.paper.dataset import ContactDataset, split_by_pose
from services.inference.network.paper.making import SEEDS_A_BLOCK, Tell, drawn_contacts, workcell
from services.inference.network.paper.paper_rows import paper_rows
from services.inference.network.paper.training import train
from services.inference.network.sequence.data import touch_sequences
from services.inference.network.sequence.model import SequenceTraining, train_sequence_network
from services.inference.network.settings import TrainingSettings

# with ten rows the result depends much on the initial weights
LEAVE_ONE_OUT_NETWORKS = 8


def train_on_table(
    data: Path, out: Path | None, seed: int, settings: TrainingSettings, command: str, floor_contacts: int, tell: Tell
) -> dict[str, Any]:
    """Train the paper's network on a data set split by pose, and evaluate it; the weights go to `out`."""
    table = read_contacts(data)
    split = split_by_pose(ContactDataset.of(table), seed)

    def on_epoch(epoch: int, training: float, validation: float | None) -> None:
        tell(f"{settings.optimiser.value}: error {validation or training:.5f}", epoch, settings.epochs)

    network, curves = train(
        split.training, seed, command, split.validation, settings, table.sha256(), table.origin.command, on_epoch,
        table.origin.code,
    )  # fmt: skip
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        network.save(out)
    origin = table.origin
    parts = evaluation.judge(network, split)
    return {
        "record": dataclasses.asdict(network.record),
        "hidden": settings.hidden,
        "optimiser": settings.optimiser.value,
        "weights": "" if out is None else str(out),
        "data": {"folder": str(data), "samples": len(table), "contacts": len(table.touched()), **origin.model_dump()},
        "curves": evaluation.curves_of(curves),
        "parts": parts,
        "states": evaluation.by_state(network, split.test),
        "floor": _floor(origin.settings, floor_contacts, tell),
        "doubts": evaluation.doubts_of(curves.best, True, parts["test"]["network"], parts["test"]["mean"]),
    }


def _floor(drawn: dict[str, float], contacts: int, tell: Tell) -> dict[str, Any] | None:
    """The floor for a data set's own ranges: single contacts of the mechanics, without friction and noise."""
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
        # larger than any seed of a data set
        made.append(drawn_contacts(cell, 10**9 + block, settings))
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
    """The ten printed rows: errors in the sample, as printed in the paper, and leave-one-out errors."""
    dataset = paper_rows()
    network, curves = train(dataset, seed, "crosspih train --paper-rows", settings=settings)
    inside = network.predict(dataset.wrench)
    seeds = range(seed, seed + LEAVE_ONE_OUT_NETWORKS)
    predicted, means = evaluation.leave_one_out(
        dataset, seeds, settings, lambda done: tell("leaving one out", done, len(dataset))
    )
    off = np.degrees(predicted - dataset.angles_rad)
    of_each = np.sqrt(np.mean(off**2, axis=1))
    left_out = evaluation.figures((predicted - dataset.angles_rad).reshape(-1, 3))
    of_the_mean = evaluation.figures(means - dataset.angles_rad)
    return {
        "record": dataclasses.asdict(network.record),
        "hidden": settings.hidden,
        "optimiser": settings.optimiser.value,
        "curves": evaluation.curves_of(curves),
        "in_sample": evaluation.figures(inside - dataset.angles_rad),
        "doubts": evaluation.doubts_of(curves.best, False, left_out, of_the_mean),
        "leave_one_out": left_out,
        "leave_one_out_networks": len(seeds),
        "leave_one_out_rms_least_deg": np.round(of_each.min(axis=0), 4).tolist(),
        "leave_one_out_rms_most_deg": np.round(of_each.max(axis=0), 4).tolist(),
        "mean_of_the_others": of_the_mean,
        "true_deg": np.round(np.degrees(dataset.angles_rad), 4).tolist(),
        "in_sample_deg": np.round(np.degrees(inside), 4).tolist(),
        "leave_one_out_deg": np.round(np.degrees(predicted[0]), 4).tolist(),
    }


def train_sequences(out: Path, sequences: int, touches: int, epochs: int, seed: int, tell: Tell) -> dict[str, Any]:
    """Make histories of touches, train the sequence network on them, and save it."""
    # more threads would sum in another order, which changes the last bits
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
