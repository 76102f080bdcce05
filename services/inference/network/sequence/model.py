"""A recurrent network over touches: history to a Gaussian over the hole's pose error.

An encoder processes each touch's features, a GRU (Cho et al. 2014) keeps the history, and a head gives mean and
precision factor of the error in units of the prior's sd, after every touch. Trained on the Gaussian's negative log
likelihood, so that it learns its own uncertainty (Nix and Weigend 1994).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from crosspih_common.geometry import Pose
from crosspih_common.geometry.pose import Array
from crosspih_common.shapes import Peg
from services.inference.network.sequence.data import SequenceDataset
from services.inference.network.sequence.touch_features import (
    FEATURES,
    TouchHistory,
    symmetries,
    touch_features,
    turn_pose_error,
)

HIDDEN = 96
# 6 means, 6 logarithms of the precision factor's diagonal, 15 below it
OUTPUTS = 27
LOG_LOW, LOG_HIGH = -2.0, 7.0


@dataclass(frozen=True, slots=True)
class SequenceRecord:
    """The origin of a sequence network, written into its file. `peg_m` is the peg's section at the body."""

    command: str
    seed: int
    dataset_sha256: str
    sequences: int
    touches: int
    epochs: int
    train_nll: tuple[float, ...]
    validation_nll: tuple[float, ...]
    peg_m: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class SequenceTraining:
    """Adam with a cosine schedule from lr to zero; stops when the validation has not improved for `patience` epochs."""

    epochs: int = 60
    batch: int = 256
    lr: float = 2e-3
    patience: int = 12
    validation_share: float = 0.1


class _Layers(torch.nn.Module):
    def __init__(self, hidden: int) -> None:
        super().__init__()
        self.encoder = torch.nn.Sequential(
            torch.nn.Linear(FEATURES, hidden), torch.nn.SiLU(), torch.nn.Linear(hidden, hidden), torch.nn.SiLU()
        )
        self.memory = torch.nn.GRU(hidden, hidden, batch_first=True)
        self.head = torch.nn.Sequential(
            torch.nn.Linear(2 * hidden, hidden), torch.nn.SiLU(), torch.nn.Linear(hidden, OUTPUTS)
        )

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        encoded = self.encoder(features)
        kept, _ = self.memory(encoded)
        return self.head(torch.cat([kept, encoded], dim=-1))  # type: ignore[no-any-return]


@dataclass(slots=True, eq=False)
class SequenceNetwork:
    """Touch history to the hole's pose error and its covariance."""

    peg: Peg
    record: SequenceRecord
    hidden: int = HIDDEN
    layers: _Layers = field(init=False)

    def __post_init__(self) -> None:
        self.layers = _Layers(self.hidden)

    def predict(self, history: TouchHistory) -> tuple[Array, Array]:
        """Mean (..., K, 6) of the pose error (right perturbation of the prior, m and rad) after each touch, and its
        covariance (..., K, 6, 6)."""
        features = touch_features(self.peg, history)
        with torch.no_grad():
            output = self.layers(torch.from_numpy(features.reshape(-1, *features.shape[-2:])))
            mean, factor = _split(output)
        shape = features.shape[:-1]
        sd = history.prior_sd[..., None, :]
        inverse = np.linalg.inv(factor.double().numpy()).reshape(*shape, 6, 6) * sd[..., :, None]
        return mean.double().numpy().reshape(*shape, 6) * sd, inverse @ np.swapaxes(inverse, -1, -2)

    def pose(self, prior: Pose, history: TouchHistory) -> tuple[Pose, Array]:
        """The hole's pose after one history (K touches), and its covariance (6, 6) as a right perturbation of it."""
        mean, covariance = (values[-1] for values in self.predict(history))
        move = Pose.from_rotvec(mean[3:], mean[:3])
        # the translation error is along the prior's axes
        turn = np.eye(6)
        turn[:3, :3] = move.rotation.T
        return prior @ move, turn @ covariance @ turn.T

    def save(self, path: Path) -> None:
        """Weights as safetensors in single precision; the record as metadata."""
        tensors = {name: value.contiguous() for name, value in self.layers.state_dict().items()}
        save_file(tensors, str(path), metadata={"sequence_record": json.dumps(asdict(self.record))})

    @classmethod
    def load(cls, path: Path, peg: Peg) -> SequenceNetwork:
        """Read what `save` wrote. Raises ValueError for any other file, or one trained for another peg."""
        try:
            with safe_open(str(path), framework="pt") as file:
                metadata = file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
        except SafetensorError as error:
            raise ValueError(f"{path} is no sequence network ({error}): train it anew") from None
        if "sequence_record" not in metadata:
            raise ValueError(f"{path} is no sequence network: train it anew")
        content = json.loads(metadata["sequence_record"])
        for name in ("train_nll", "validation_nll"):
            content[name] = tuple(content[name])
        content["peg_m"] = tuple((x, y) for x, y in content["peg_m"])
        record = SequenceRecord(**content)
        if not np.array_equal(np.array(record.peg_m), np.array(section_of(peg))):
            raise ValueError(f"{path} was trained for another peg: train it for this one")
        network = cls(peg, record, tensors["memory.weight_hh_l0"].shape[1])
        network.layers.load_state_dict(tensors)
        return network


def section_of(peg: Peg) -> tuple[tuple[float, float], ...]:
    """The peg's section at the body and at the tip, which identifies the network's peg; m, rounded to the
    micrometre."""
    corners = np.concatenate([peg.outline_m(z)[:, :2] for z in (peg.taper_start_m, peg.tip_m)])
    corners = np.round(np.vstack([corners, [peg.taper_start_m, peg.tip_m]]), 6) + 0.0
    return tuple((float(x), float(y)) for x, y in corners)


def train_sequence_network(
    peg: Peg,
    dataset: SequenceDataset,
    seed: int,
    command: str,
    settings: SequenceTraining | None = None,
    on_epoch: Callable[[int, float, float], None] = lambda epoch, train, validation: None,
) -> SequenceNetwork:
    """Train with early stopping on held-out histories. In each epoch every history is transformed by a random symmetry
    of the peg. `on_epoch` is called with the epoch and both losses. Raises ValueError below 20 histories."""
    if len(dataset) < 20:
        raise ValueError("training a sequence network wants at least 20 histories")
    settings = settings or SequenceTraining()
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(dataset))
    held = max(round(settings.validation_share * len(dataset)), 1)
    training, validation = dataset.rows(order[held:]), dataset.rows(order[:held])
    touches = dataset.history.wrench.shape[1]
    record = SequenceRecord(command, seed, dataset.sha256(), len(dataset), touches, 0, (), (), section_of(peg))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = SequenceNetwork(peg, record)
    turns = symmetries(peg)
    optimiser = torch.optim.Adam(network.layers.parameters(), lr=settings.lr)
    batches = -(-len(training) // settings.batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, settings.lr, total_steps=settings.epochs * batches, pct_start=0.1
    )
    best: dict[str, torch.Tensor] = {}
    curves: tuple[list[float], list[float]] = ([], [])
    checked = _tensors(peg, validation)
    for epoch in range(settings.epochs):
        features, target = _tensors(peg, _augmented(training, turns, rng))
        shuffled = torch.from_numpy(rng.permutation(len(training)))
        total = 0.0
        for part in torch.split(shuffled, settings.batch):
            optimiser.zero_grad()
            loss = _negative_log_likelihood(network.layers(features[part]), target[part])
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(network.layers.parameters(), 1.0)
            optimiser.step()
            schedule.step()
            total += float(loss.detach()) * len(part)
        with torch.no_grad():
            reached = float(_negative_log_likelihood(network.layers(checked[0]), checked[1]))
        curves[0].append(round(total / len(training), 4))
        curves[1].append(round(reached, 4))
        on_epoch(epoch + 1, curves[0][-1], curves[1][-1])
        if curves[1][-1] <= min(curves[1]):
            best = {name: value.clone() for name, value in network.layers.state_dict().items()}
        elif epoch - int(np.argmin(curves[1])) >= settings.patience:
            break
    network.layers.load_state_dict(best)
    network.record = SequenceRecord(
        command, seed, record.dataset_sha256, len(dataset), touches, len(curves[0]),
        tuple(curves[0]), tuple(curves[1]), record.peg_m,
    )  # fmt: skip
    return network


def _augmented(dataset: SequenceDataset, turns: Array, rng: np.random.Generator) -> SequenceDataset:
    chosen = turns[rng.integers(0, len(turns), len(dataset))]
    return SequenceDataset(dataset.history.turned(chosen), turn_pose_error(chosen, dataset.error))


def _tensors(peg: Peg, dataset: SequenceDataset) -> tuple[torch.Tensor, torch.Tensor]:
    """Features (N, K, F) and the error in units of the prior's sd, once for each touch (N, K, 6)."""
    features = touch_features(peg, dataset.history)
    target = (dataset.error / dataset.history.prior_sd).astype(np.float32)
    return torch.from_numpy(features), torch.from_numpy(np.repeat(target[:, None], features.shape[1], axis=1))


def _split(output: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Mean (..., 6) and lower triangular precision factor L (..., 6, 6): the precision is L^T L."""
    mean, log_diagonal, below = torch.split(output, [6, 6, 15], dim=-1)
    # a smooth limit, so that no gradient vanishes
    middle, half = 0.5 * (LOG_LOW + LOG_HIGH), 0.5 * (LOG_HIGH - LOG_LOW)
    diagonal = torch.exp(middle + half * torch.tanh((log_diagonal - middle) / half))
    factor = torch.diag_embed(diagonal)
    rows, columns = torch.tril_indices(6, 6, -1)
    # rows share the scale of their diagonal, so that a direction may be arbitrarily sharp
    factor[..., rows, columns] = below * diagonal[..., rows]
    return mean, factor


def _negative_log_likelihood(output: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Mean over touches of the Gaussian's negative log likelihood, its constant left out."""
    mean, factor = _split(output)
    white = (factor @ (target - mean)[..., None])[..., 0]
    diagonal = torch.diagonal(factor, dim1=-2, dim2=-1)
    # pseudo-Huber in the whitened error: a touch that another wall explains must not dominate the fit
    square = (white**2).sum(-1)
    robust = 2.0 * 36.0 * (torch.sqrt(1.0 + square / 36.0) - 1.0)
    return (0.5 * robust - torch.log(diagonal).sum(-1)).mean()


def history_of(
    prior: Pose, prior_sd: Array, poses: list[Pose], wrenches: list[Array], directions: list[Array]
) -> TouchHistory:
    """A history (K touches) from poses in base, wrenches in the peg frame and motions in base."""
    into = prior.inverse()
    local = [into @ pose for pose in poses]
    return TouchHistory(
        np.array([pose.rotation for pose in local]),
        np.array([pose.translation_m for pose in local]),
        np.array(wrenches, float),
        np.array([into.rotate(direction) for direction in directions]),
        np.asarray(prior_sd, float),
    )


__all__ = ["SequenceNetwork", "SequenceRecord", "SequenceTraining", "history_of", "train_sequence_network"]
