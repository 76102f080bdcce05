"""Training settings of the paper's network, and the place of shipped weights; without torch, so that it loads fast."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path

HIDDEN_NEURONS = 150
PAPER_WEIGHTS = Path(__file__).parent / "paper" / "weights.safetensors"
SEQUENCE_WEIGHTS = Path(__file__).parent / "sequence" / "weights.safetensors"


class Optimiser(str, Enum):
    """The training algorithm."""

    TRAINGDX = "traingdx"  # as printed: gradient descent, momentum, adaptive rate, full batch
    ADAM = "adam"  # Kingma and Ba 2015, small batches
    LBFGS = "lbfgs"  # Liu and Nocedal 1989, full batch, strong Wolfe search
    LM = "lm"  # Levenberg-Marquardt as MATLAB's trainlm


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """As printed by default: 150 hidden neurons, MSE 1e-3 on outputs scaled to 0..1, at most 1000 epochs.

    patience: epochs without a better validation error after which training stops; when None 6, MATLAB's max_fail, for
    lm and 60 for the others, whose steps are small. lr: traingdx's and Adam's first rate, their own default when None;
    batch: Adam's.
    """

    optimiser: Optimiser = Optimiser.TRAINGDX
    hidden: int = HIDDEN_NEURONS
    epochs: int = 1000
    goal: float = 1e-3
    patience: int | None = None
    lr: float | None = None
    batch: int = 256
