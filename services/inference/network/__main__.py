"""`python -m services.inference.network`: train the paper's network on contacts made by the mechanics."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

import numpy as np

from crosspih_common.shapes import CrossHole, CrossPeg
from services.inference.network.model import train
from services.inference.network.synthesis import single_contact_dataset


def main() -> None:
    """Draw contacts, train, write the weights, print the record."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--samples", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--epochs", type=int, default=1000)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    peg = CrossPeg()
    dataset = single_contact_dataset(
        peg, CrossHole.around(peg, 1e-4), arguments.samples, np.random.default_rng(arguments.seed)
    )
    command = (
        "python -m services.inference.network "
        f"--samples {arguments.samples} --seed {arguments.seed} --epochs {arguments.epochs} --out {arguments.out.name}"
    )
    network = train(dataset, arguments.seed, command, epochs=arguments.epochs)
    network.save(arguments.out)
    error = np.degrees(np.sqrt(np.mean((network.predict(dataset.wrench) - dataset.angles_rad) ** 2, axis=0)))
    print(json.dumps({**dataclasses.asdict(network.record), "rms_deg": np.round(error, 3).tolist()}, indent=2))


if __name__ == "__main__":
    main()
