"""Trains the paper's network: by the paper's method (traingdx, Section 4.2) or three others, with early stopping."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch

from crosspih_common.provenance import code_version
from services.inference.network.paper.dataset import ContactDataset
from services.inference.network.paper.levenberg import LevenbergMarquardt
from services.inference.network.paper.model import AngleNetwork, TrainingRecord, nguyen_widrow
from services.inference.network.paper.traingdx import TrainGdx
from services.inference.network.settings import Optimiser, TrainingSettings


@dataclass(frozen=True, slots=True)
class Curves:
    """Mean square errors on outputs scaled to 0..1, before training and after each epoch; `best`: the epoch whose
    weights were kept."""

    training: tuple[float, ...]
    validation: tuple[float, ...]
    best: int
    stopped: str


OnEpoch = Callable[[int, float, float | None], None]


def _silent(epoch: int, training: float, validation: float | None) -> None:
    return


def train(
    training: ContactDataset,
    seed: int,
    command: str,
    validation: ContactDataset | None = None,
    settings: TrainingSettings | None = None,
    dataset_sha256: str = "",
    dataset_command: str = "",
    on_epoch: OnEpoch = _silent,
    dataset_code: str = "",
) -> tuple[AngleNetwork, Curves]:
    """Train on `training`; inputs and outputs are scaled by its extremes only.

    Ends at the goal, at the last epoch, when no step helps any more, or when the validation error has not fallen for
    `patience` epochs; the weights with the least validation error are kept (without `validation`: the last). `command`
    and the data set's hash, command and code go into the record. The same arguments give the same weights to the last
    bit. Raises ValueError below 2 contacts.
    """
    if len(training) < 2:
        raise ValueError("training wants at least 2 contacts in the dataset")
    settings = settings or TrainingSettings()
    record = TrainingRecord(
        command, seed, dataset_sha256 or training.sha256(),
        len(training) + (0 if validation is None else len(validation)), 0, settings.goal, float("inf"), False,
    )  # fmt: skip
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = AngleNetwork(
            training.wrench.min(axis=0),
            training.wrench.max(axis=0),
            training.angles_rad.min(axis=0),
            training.angles_rad.max(axis=0),
            record,
            settings.hidden,
        )
        nguyen_widrow(network.layers)
    data = network.scaled(training.wrench, training.angles_rad)
    held = None if validation is None else network.scaled(validation.wrench, validation.angles_rad)
    patience = settings.patience or (6 if settings.optimiser is Optimiser.LM else 60)
    epoch_step = _stepper(network.layers, data, settings, seed)

    def check() -> float | None:
        return None if held is None else _error(network.layers, held)

    reached, checked = _error(network.layers, data), check()
    curves: tuple[list[float], list[float]] = ([reached], [] if checked is None else [checked])
    best, best_weights = 0, _copy(network.layers)
    stopped = "epochs"
    while len(curves[0]) <= settings.epochs:
        if reached <= settings.goal:
            stopped = "goal"
            break
        reached, goes_on = epoch_step()
        checked = check()
        curves[0].append(reached)
        epoch = len(curves[0]) - 1
        if checked is None:
            best = epoch
        else:
            curves[1].append(checked)
            if checked < curves[1][best]:
                best, best_weights = epoch, _copy(network.layers)
        on_epoch(epoch, reached, checked)
        if not goes_on:
            stopped = "no step helps"
            break
        if epoch - best >= patience:
            stopped = "validation"
            break
    if held is not None:
        network.layers.load_state_dict(best_weights)
    network.record = TrainingRecord(
        command, seed, record.dataset_sha256, record.samples, len(curves[0]) - 1, settings.goal, curves[0][best],
        curves[0][best] <= settings.goal, settings.optimiser.value, dataset_command, len(training),
        0 if validation is None else len(validation), curves[1][best] if curves[1] else None, stopped, dataset_code,
        code_version(),
    )  # fmt: skip
    return network, Curves(tuple(curves[0]), tuple(curves[1]), best, stopped)


def _copy(layers: torch.nn.Sequential) -> dict[str, torch.Tensor]:
    return {name: value.clone() for name, value in layers.state_dict().items()}


def _error(layers: torch.nn.Sequential, data: tuple[torch.Tensor, torch.Tensor]) -> float:
    with torch.no_grad():
        return float(torch.nn.functional.mse_loss(layers(data[0]), data[1]))


def _stepper(
    layers: torch.nn.Sequential, data: tuple[torch.Tensor, torch.Tensor], settings: TrainingSettings, seed: int
) -> Callable[[], tuple[float, bool]]:
    """A function that does one epoch: (error reached, whether to go on)."""
    inputs, targets = data
    if settings.optimiser is Optimiser.LM:
        levenberg = LevenbergMarquardt(layers)
        return lambda: levenberg.step(inputs, targets)
    if settings.optimiser is Optimiser.ADAM:
        return _adam(layers, data, settings, seed)
    optimiser: torch.optim.Optimizer
    if settings.optimiser is Optimiser.LBFGS:
        optimiser = torch.optim.LBFGS(
            layers.parameters(), lr=1.0, max_iter=1, max_eval=25, history_size=50, line_search_fn="strong_wolfe",
            tolerance_grad=0.0, tolerance_change=0.0,
        )  # fmt: skip
    else:
        optimiser = TrainGdx(layers.parameters(), lr=0.01 if settings.lr is None else settings.lr)

    def closure() -> torch.Tensor:
        optimiser.zero_grad()
        error = torch.nn.functional.mse_loss(layers(inputs), targets)
        error.backward()  # type: ignore[no-untyped-call]
        return error.detach()

    def step() -> tuple[float, bool]:
        optimiser.step(closure)
        return _error(layers, data), True

    return step


def _adam(
    layers: torch.nn.Sequential, data: tuple[torch.Tensor, torch.Tensor], settings: TrainingSettings, seed: int
) -> Callable[[], tuple[float, bool]]:
    inputs, targets = data
    optimiser = torch.optim.Adam(layers.parameters(), lr=3e-3 if settings.lr is None else settings.lr)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, settings.epochs)
    generator = torch.Generator().manual_seed(seed)

    def step() -> tuple[float, bool]:
        for part in torch.split(torch.randperm(len(inputs), generator=generator), settings.batch):
            optimiser.zero_grad()
            torch.nn.functional.mse_loss(layers(inputs[part]), targets[part]).backward()  # type: ignore[no-untyped-call]
            optimiser.step()
        schedule.step()
        return _error(layers, data), True

    return step
