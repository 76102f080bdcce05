"""Evaluates a trained network: errors by split, against guessing the mean and against the floor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from crosspih_common.geometry.pose import Array
from services.inference.network.paper.dataset import ContactDataset, Split
from services.inference.network.paper.floor import floor_rms_rad, nearest_neighbours
from services.inference.network.paper.model import AngleNetwork
from services.inference.network.paper.training import Curves, train
from services.inference.network.settings import TrainingSettings

ANGLES = ("alpha", "beta", "gamma")
SHOWN = 400


def figures(error_rad: Array) -> dict[str, list[float]]:
    """RMS, p95 and the largest of errors (n, 3), degrees."""
    degrees = np.degrees(np.abs(error_rad))
    return {
        "rms_deg": _rounded(np.sqrt(np.mean(degrees**2, axis=0))),
        "p95_deg": _rounded(np.percentile(degrees, 95, axis=0)),
        "max_deg": _rounded(degrees.max(axis=0)),
        "within_1_deg": _rounded(np.mean(degrees <= 1.0, axis=0)),
    }


def judge(network: AngleNetwork, split: Split) -> dict[str, Any]:
    """Errors of the network, of guessing the training's mean and of the nearest training contacts, on every split; and
    samples with the network's predictions, for the paper's Figure 18."""
    mean = split.training.angles_rad.mean(axis=0)
    parts: dict[str, Any] = {}
    for name in ("training", "validation", "test"):
        part: ContactDataset = getattr(split, name)
        predicted = network.predict(part.wrench)
        shown = np.linspace(0, len(part) - 1, min(len(part), SHOWN)).astype(int)
        parts[name] = {
            "samples": len(part),
            "network": figures(predicted - part.angles_rad),
            "mean": figures(mean - part.angles_rad),
            "true_deg": _rounded(np.degrees(part.angles_rad[shown])),
            "predicted_deg": _rounded(np.degrees(predicted[shown])),
            "states": part.state[shown].tolist(),
        }
    near, _ = nearest_neighbours(split.training.wrench, split.training.angles_rad, split.test.wrench, 8)
    parts["test"]["nearest_training_contacts"] = figures(near - split.test.angles_rad)
    return parts


def doubts_of(
    best_epoch: int, trained: bool, network: dict[str, list[float]], mean: dict[str, list[float]]
) -> list[str]:
    """Warnings about a network: if no epoch improved it, and for angles that it predicts no better than the mean does.
    `network`, `mean`: figures on contacts that were not used in training; `trained`: whether epochs were judged by a
    validation error.
    """
    said = []
    if trained and best_epoch == 0:
        said.append(
            "the weights that are kept are those of epoch 0, which are drawn and not trained: no epoch made the "
            "validation error smaller"
        )
    pairs = zip(ANGLES, network["rms_deg"], mean["rms_deg"], strict=True)
    if worse := [f"{name} ({own:.2f}° against {guessed:.2f}°)" for name, own, guessed in pairs if own >= guessed]:
        said.append(f"on contacts that it has not met it is no better than guessing the mean in {', '.join(worse)}")
    return said


def by_state(network: AngleNetwork, dataset: ContactDataset) -> dict[str, dict[str, Any]]:
    """Figures of the network in each contact state of a data set."""
    found: dict[str, dict[str, Any]] = {}
    for state in sorted(set(dataset.state.tolist())):
        rows = np.flatnonzero(dataset.state == state)
        error = network.predict(dataset.wrench[rows]) - dataset.angles_rad[rows]
        found[state] = {"samples": len(rows), **figures(error)}
    return found


def synthetic_floor(known: ContactDataset, asked: ContactDataset) -> dict[str, Any]:
    """The floor for the mechanics: many known contacts, and others to predict. Degrees."""
    rms = floor_rms_rad(known.wrench, known.angles_rad, asked.wrench, asked.angles_rad)
    return {
        "contacts": len(known),
        "rms_deg": _rounded(np.degrees(rms)),
        "guessing_the_mean_deg": _rounded(np.degrees(asked.angles_rad.std(axis=0))),
    }


def leave_one_out(
    dataset: ContactDataset,
    seeds: Sequence[int],
    settings: TrainingSettings,
    on_left: Callable[[int], None] = lambda done: None,
) -> tuple[Array, Array]:
    """Predict every contact by networks trained on all others, one from each of the S seeds: (predicted (S, n, 3),
    mean of the others (n, 3)), rad."""
    predicted, means = np.empty((len(seeds), len(dataset), 3)), np.empty((len(dataset), 3))
    for left in range(len(dataset)):
        others = dataset.rows(np.delete(np.arange(len(dataset)), left))
        means[left] = others.angles_rad.mean(axis=0)
        for number, seed in enumerate(seeds):
            network, _ = train(others, seed, "leave one out", settings=settings)
            predicted[number, left] = network.predict(dataset.wrench[left])
        on_left(left + 1)
    return predicted, means


def curves_of(curves: Curves, most: int = 600) -> dict[str, Any]:
    """Learning curves thinned out for drawing."""
    epochs = np.unique(np.linspace(0, len(curves.training) - 1, most).astype(int))
    return {
        "epoch": epochs.tolist(),
        "training": [curves.training[epoch] for epoch in epochs],
        "validation": [curves.validation[epoch] for epoch in epochs] if curves.validation else [],
        "best": curves.best,
        "stopped": curves.stopped,
    }


def _rounded(values: Array) -> Any:
    return np.round(np.asarray(values, float), 4).tolist()
