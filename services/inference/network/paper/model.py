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
from services.inference.network.settings import HIDDEN_NEURONS


@dataclass(frozen=True, slots=True)
class TrainingRecord:
    """The origin of a network, written into its file. mse_scaled: of the training rows, on outputs scaled to 0..1."""

    command: str
    seed: int
    dataset_sha256: str
    samples: int
    epochs: int
    goal: float
    mse_scaled: float
    reached_goal: bool
    optimiser: str = "traingdx"
    dataset_command: str = ""
    training_samples: int = 0
    validation_samples: int = 0
    validation_mse_scaled: float | None = None
    stopped: str = ""
    dataset_code: str = ""  # version of the code that made the rows
    code: str = ""  # version of the code that trained


class AngleNetwork:
    """Wrench (6,) to (alpha, beta, gamma). Columns that never change are scaled by 1."""

    def __init__(
        self,
        low_in: Array,
        high_in: Array,
        low_out: Array,
        high_out: Array,
        record: TrainingRecord,
        hidden: int = HIDDEN_NEURONS,
    ) -> None:
        self.low_in, self.span_in = np.asarray(low_in, float), _span(low_in, high_in)
        self.low_out, self.span_out = np.asarray(low_out, float), _span(low_out, high_out)
        self.record = record
        self.layers = torch.nn.Sequential(
            torch.nn.Linear(6, hidden), torch.nn.Sigmoid(), torch.nn.Linear(hidden, 3)
        ).double()

    def predict(self, wrench: ArrayLike) -> Array:
        """Error angles (..., 3), rad, of contact wrenches (..., 6)."""
        scaled = (np.asarray(wrench, float) - self.low_in) / self.span_in
        with torch.no_grad():
            output = self.layers(torch.from_numpy(scaled)).numpy()
        return np.asarray(output * self.span_out + self.low_out, dtype=float)

    def scaled(self, wrench: Array, angles_rad: Array) -> tuple[torch.Tensor, torch.Tensor]:
        """Inputs (n, 6) and targets (n, 3) as the layers see them."""
        return (
            torch.from_numpy((wrench - self.low_in) / self.span_in),
            torch.from_numpy((angles_rad - self.low_out) / self.span_out),
        )

    def save(self, path: Path) -> None:
        """Weights and scaling as safetensors; the training record as its metadata."""
        tensors = {name: value.contiguous() for name, value in self.layers.state_dict().items()}
        for name in ("low_in", "span_in", "low_out", "span_out"):
            tensors[f"scaling.{name}"] = torch.from_numpy(getattr(self, name).copy())
        save_file(tensors, str(path), metadata={"record": json.dumps(asdict(self.record))})

    @classmethod
    def load(cls, path: Path) -> AngleNetwork:
        """Read what `save` wrote. Raises ValueError for any other file."""
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
            hidden=tensors["0.weight"].shape[0],
        )
        network.layers.load_state_dict(tensors)
        return network


def _span(low: Array, high: Array) -> Array:
    span = np.asarray(high, float) - np.asarray(low, float)
    return np.where(span > 0.0, span, 1.0)


def nguyen_widrow(layers: torch.nn.Sequential) -> None:
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
