"""The 6-150-3 network of Section 4.1: logsig hidden layer, linear output, inputs and outputs scaled to 0..1."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import ArrayLike
from safetensors import safe_open
from safetensors.torch import save_file

from crosspih_common.geometry.pose import Array
from services.inference.network.dataset import ContactDataset
from services.inference.network.traingdx import TrainGdx

HIDDEN_NEURONS = 150


@dataclass(frozen=True, slots=True)
class TrainingRecord:
    """How a network came to be: written into its file."""

    command: str
    seed: int
    dataset_sha256: str
    samples: int
    epochs: int
    goal: float
    mse_scaled: float
    reached_goal: bool


class AngleNetwork:
    """Wrench (6,) to (alpha, beta, gamma). Columns that never change are scaled by 1."""

    def __init__(self, low_in: Array, high_in: Array, low_out: Array, high_out: Array, record: TrainingRecord) -> None:
        self.low_in, self.span_in = np.asarray(low_in, float), _span(low_in, high_in)
        self.low_out, self.span_out = np.asarray(low_out, float), _span(low_out, high_out)
        self.record = record
        self.layers = torch.nn.Sequential(
            torch.nn.Linear(6, HIDDEN_NEURONS), torch.nn.Sigmoid(), torch.nn.Linear(HIDDEN_NEURONS, 3)
        ).double()

    def predict(self, wrench: ArrayLike) -> Array:
        """Error angles (..., 3), rad, of contact wrenches (..., 6)."""
        scaled = (np.asarray(wrench, float) - self.low_in) / self.span_in
        with torch.no_grad():
            output = self.layers(torch.from_numpy(scaled)).numpy()
        return np.asarray(output * self.span_out + self.low_out, dtype=float)

    def save(self, path: Path) -> None:
        """Weights and scaling as safetensors; the training record as its metadata."""
        tensors = {name: value.contiguous() for name, value in self.layers.state_dict().items()}
        for name in ("low_in", "span_in", "low_out", "span_out"):
            tensors[f"scaling.{name}"] = torch.from_numpy(getattr(self, name).copy())
        save_file(tensors, str(path), metadata={"record": json.dumps(asdict(self.record))})

    @classmethod
    def load(cls, path: Path) -> AngleNetwork:
        """Read what `save` wrote; ValueError when the file is none of ours."""
        with safe_open(str(path), framework="pt") as file:
            metadata = file.metadata() or {}
            if "record" not in metadata:
                raise ValueError(f"{path} carries no training record: train the network anew")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
        scaling = {
            name: tensors.pop(f"scaling.{name}").numpy() for name in ("low_in", "span_in", "low_out", "span_out")
        }
        network = cls(
            scaling["low_in"],
            scaling["low_in"] + scaling["span_in"],
            scaling["low_out"],
            scaling["low_out"] + scaling["span_out"],
            TrainingRecord(**json.loads(metadata["record"])),
        )
        network.layers.load_state_dict(tensors)
        return network


def train(
    dataset: ContactDataset, seed: int, command: str, goal: float = 1e-3, epochs: int = 1000, lr: float = 0.01
) -> AngleNetwork:
    """Train as printed: traingdx, MSE on outputs scaled to 0..1, until the goal or 1000 iterations. Full batch.

    `command` is what the user ran; it goes into the record.
    """
    if len(dataset.wrench) < 2:
        raise ValueError("training wants at least 2 contacts in the dataset")
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = AngleNetwork(
            dataset.wrench.min(axis=0),
            dataset.wrench.max(axis=0),
            dataset.angles_rad.min(axis=0),
            dataset.angles_rad.max(axis=0),
            TrainingRecord(command, seed, dataset.sha256(), len(dataset.wrench), 0, goal, float("inf"), False),
        )
        _nguyen_widrow(network.layers)
    inputs = torch.from_numpy((dataset.wrench - network.low_in) / network.span_in)
    targets = torch.from_numpy((dataset.angles_rad - network.low_out) / network.span_out)
    optimiser = TrainGdx(network.layers.parameters(), lr=lr)

    def closure() -> float:
        optimiser.zero_grad()
        error = torch.nn.functional.mse_loss(network.layers(inputs), targets)
        error.backward()  # type: ignore[no-untyped-call]
        return float(error.detach())

    error = closure()
    done = 0
    while done < epochs and error > goal:
        error = float(optimiser.step(closure))
        done += 1
    network.record = TrainingRecord(
        command, seed, dataset.sha256(), len(dataset.wrench), done, goal, error, error <= goal
    )
    return network


def _span(low: Array, high: Array) -> Array:
    span = np.asarray(high, float) - np.asarray(low, float)
    return np.where(span > 0.0, span, 1.0)


def _nguyen_widrow(layers: torch.nn.Sequential) -> None:
    """MATLAB's start (initnw) for inputs in 0..1: spread the active regions of the hidden neurons over the inputs."""
    hidden = layers[0]
    assert isinstance(hidden, torch.nn.Linear)
    with torch.no_grad():
        neurons, inputs = hidden.weight.shape
        weight = torch.rand(neurons, inputs, dtype=torch.float64) * 2.0 - 1.0
        weight *= 0.7 * neurons ** (1.0 / inputs) / weight.norm(dim=1, keepdim=True)
        bias = 0.7 * neurons ** (1.0 / inputs) * torch.linspace(-1.0, 1.0, neurons, dtype=torch.float64)
        bias *= torch.sign(weight[:, 0])
        # initnw works on inputs in -1..1 and logsig's active range of +-4.
        hidden.weight.copy_(4.0 * weight)
        hidden.bias.copy_(4.0 * (bias / 2.0) - (2.0 * weight).sum(dim=1))
