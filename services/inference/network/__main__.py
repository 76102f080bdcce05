"""`python -m services.inference.network`: train the paper's network, on contacts collected in a cell or made by the
mechanics."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

import numpy as np

from crosspih_common.shapes import CrossHole, CrossPeg
from services.inference.network.dataset import ContactDataset
from services.inference.network.model import train
from services.inference.network.synthesis import single_contact_dataset


def main() -> None:
    """Load or draw contacts, train, write the weights, print the record."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--data", type=Path, help="contacts that `crosspih train` collected; without: the mechanics'")
    parser.add_argument("--samples", type=int, default=2000, help="contacts that the mechanics make")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--epochs", type=int, default=1000)
    parser.add_argument("--command", default="", help="what goes into the weights' record as their origin")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    if arguments.data is not None:
        dataset = ContactDataset.load(arguments.data)
        command = arguments.command or f"python -m services.inference.network --data {arguments.data.name}"
    else:
        peg = CrossPeg()
        rng = np.random.default_rng(arguments.seed)
        dataset = single_contact_dataset(peg, CrossHole.around(peg, 1e-4), arguments.samples, rng)
        command = arguments.command or (
            "python -m services.inference.network "
            f"--samples {arguments.samples} --seed {arguments.seed} --epochs {arguments.epochs}"
        )
    network = train(dataset, arguments.seed, command, epochs=arguments.epochs)
    network.save(arguments.out)
    predicted = network.predict(dataset.wrench)
    error = np.degrees(np.sqrt(np.mean((predicted - dataset.angles_rad) ** 2, axis=0)))
    guess = np.degrees(np.std(dataset.angles_rad, axis=0))
    figures = {"rms_deg": np.round(error, 3).tolist(), "guessing_the_mean_deg": np.round(guess, 3).tolist()}
    print(json.dumps({**dataclasses.asdict(network.record), **figures}, indent=2))


if __name__ == "__main__":
    main()
