"""`python -m services.inference.mechanics`: first contacts and pushes per second, see `benchmark`."""

from __future__ import annotations

import argparse
import json
import os
import sys

# numpy reads this when first loaded: more threads than processes only slow each other down.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from services.inference.mechanics.benchmark import OUTLINES, measured


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--peg", nargs="+", default=["cross"], choices=[*OUTLINES, "all"])
    parser.add_argument("--processes", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--seconds", type=float, default=3.0, help="for each method and number of processes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    names = OUTLINES if "all" in arguments.peg else arguments.peg
    shown = []
    for name in names:
        for processes in arguments.processes:
            row = measured(name, arguments.seconds, processes, arguments.seed)
            shown.append(row)
            if not arguments.json:
                cells = [
                    f"{what} {row[f'{key}_per_s']:,}/s ({row[f'{key}_per_cpu_s']:,} a cpu second)"
                    for what, key in (
                        ("first contacts", "first"),
                        ("of every pair", "every_pair"),
                        ("plain", "plain"),
                        ("pushes", "push"),
                    )
                ]
                print(f"{name}, {processes} processes: {', '.join(cells)}; {row['ratio_to_plain']} times the plain")
                sys.stdout.flush()
    if arguments.json:
        print(json.dumps(shown))


if __name__ == "__main__":
    main()
