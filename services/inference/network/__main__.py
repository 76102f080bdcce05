"""`python -m services.inference.network`: makes contacts, trains the paper's network and the sequence network.

It writes JSON lines on standard output: {"doing", "done", "total"} as it goes on, and {"result"} at the end.
`crosspih dataset synthesise` and `crosspih train` run it.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from crosspih_common.errors import CrosspihError
from crosspih_common.modules import not_installed
from services.inference.network.settings import Optimiser, TrainingSettings

SAY_EVERY_S = 0.2


class Teller:
    """Reports progress, at limited rate: as JSON, or for people on standard error."""

    def __init__(self, for_people: bool = False) -> None:
        self._said = 0.0
        self._for_people = for_people

    def __call__(self, doing: str, done: int, total: int) -> None:
        now = time.monotonic()
        if done >= total or now - self._said > SAY_EVERY_S:
            self._said = now
            if self._for_people:
                print(f"\r{doing} {done} of {total}", end="\n" if done >= total else "", file=sys.stderr, flush=True)
                return
            print(json.dumps({"doing": doing, "done": done, "total": total}), flush=True)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m services.inference.network", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, run: Callable[..., dict[str, Any]], text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(run=run)
        return sub

    sub = command("synthesise", _synthesise, "single contacts from the mechanics, as Parquet")
    sub.add_argument("--poses", type=int, default=20_000)
    sub.add_argument("--seed", type=int, default=1)
    sub.add_argument("--out", type=Path, required=True)
    for name, default in (
        ("angle-rad", 0.1), ("lateral-m", 0.005), ("force-n", 20.0), ("friction", 0.0), ("force-sd-n", 0.0),
        ("moment-sd-nm", 0.0),
    ):  # fmt: skip
        sub.add_argument(f"--{name}", type=float, default=default)

    sub = command("train", _train, "the paper's network, on a data set of contacts or on the paper's ten rows")
    source = sub.add_mutually_exclusive_group(required=True)
    source.add_argument("--data", type=Path, help="a data set's folder")
    source.add_argument("--paper-rows", action="store_true", help="the ten printed rows, in-sample and leave-one-out")
    sub.add_argument("--out", type=Path, help="where the weights go")
    sub.add_argument("--seed", type=int, default=0)
    sub.add_argument("--command", default="", help="what goes into the weights' record as their origin")
    sub.add_argument("--floor-contacts", type=int, default=40_000, help="made by the mechanics, to find the floor with")
    for field in dataclasses.fields(TrainingSettings):
        kind: Any = {"optimiser": Optimiser, "goal": float, "lr": float}.get(field.name, int)
        sub.add_argument(f"--{field.name}", type=kind, default=field.default)

    sub = command("sequence", _sequence, "the sequence network, on histories of touches made by the mechanics")
    sub.add_argument("--sequences", type=int, default=40_000)
    sub.add_argument("--touches", type=int, default=8)
    sub.add_argument("--epochs", type=int, default=60)
    sub.add_argument("--seed", type=int, default=1)
    sub.add_argument("--out", type=Path, required=True)

    sub = command("compare", _compare, "the sequence network's errors beside the estimator's, on the same touches")
    sub.add_argument("--weights", type=Path, help="the shipped ones when left out")
    sub.add_argument("--table", action="store_true", help="print a table for people, no JSON")
    sub.add_argument("--trials", type=int, default=100)
    sub.add_argument("--touches", type=int, default=4)
    sub.add_argument("--seed", type=int, default=1000)

    sub = command("record", _record, "how weights came to be: command, data set, code, as their file says")
    sub.add_argument("weights", type=Path, nargs="?", help="the shipped ones of the paper's network when left out")
    return parser.parse_args()


def _synthesise(arguments: argparse.Namespace, tell: Teller) -> dict[str, Any]:
    from services.inference.network.paper.making import make_contacts

    names = ("angle_rad", "lateral_m", "force_n", "friction", "force_sd_n", "moment_sd_nm")
    settings = {name: float(getattr(arguments, name)) for name in names}
    return make_contacts(arguments.out, arguments.poses, arguments.seed, settings, tell)


def _train(arguments: argparse.Namespace, tell: Teller) -> dict[str, Any]:
    # torch takes seconds to import, so it is imported only for training
    from services.inference.network.teaching import train_on_paper_rows, train_on_table

    names = [field.name for field in dataclasses.fields(TrainingSettings)]
    settings = TrainingSettings(**{name: getattr(arguments, name) for name in names})
    if arguments.paper_rows:
        return train_on_paper_rows(settings, arguments.seed, tell)
    command = arguments.command or " ".join(["python -m services.inference.network", *sys.argv[1:]])
    return train_on_table(
        arguments.data, arguments.out, arguments.seed, settings, command, arguments.floor_contacts, tell
    )


def _sequence(arguments: argparse.Namespace, tell: Teller) -> dict[str, Any]:
    from services.inference.network.teaching import train_sequences

    return train_sequences(
        arguments.out, arguments.sequences, arguments.touches, arguments.epochs, arguments.seed, tell
    )


def _compare(arguments: argparse.Namespace, tell: Teller) -> dict[str, Any]:
    from services.inference.network.paper.making import workcell
    from services.inference.network.sequence.comparison import compare

    return compare(workcell(), arguments.weights, arguments.trials, arguments.touches, arguments.seed, tell)


def _record(arguments: argparse.Namespace, tell: Teller) -> dict[str, Any]:
    from services.inference.network.paper.model import AngleNetwork
    from services.inference.network.settings import PAPER_WEIGHTS

    path = arguments.weights or PAPER_WEIGHTS
    return {"weights": str(path), **dataclasses.asdict(AngleNetwork.load(path).record)}


def main() -> None:
    """Run the command line; an error is one line on standard error and status 1."""
    arguments = _arguments()
    for_people = getattr(arguments, "table", False)
    try:
        result = arguments.run(arguments, Teller(for_people))
    except (CrosspihError, ValueError, OSError) as error:
        print(error, file=sys.stderr)
        sys.exit(1)
    except ModuleNotFoundError as error:
        print(json.dumps({"error": not_installed(error)}) if not for_people else not_installed(error))
        sys.exit(1)
    if for_people:
        from services.inference.network.sequence.comparison import as_text

        print(as_text(result))
    else:
        print(json.dumps({"result": result}))


if __name__ == "__main__":
    main()
