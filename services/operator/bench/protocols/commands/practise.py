"""`crosspih cell practise`: simulated devices with which to follow docs/hardware/in-a-day.md before real ones are
there.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer
import yaml
from rich.console import Console

from services.operator.bench.options import errors_shown
from services.operator.bench.protocols.addresses import private_network
from services.operator.bench.protocols.plants import (
    ADDRESSES,
    ARM,
    HERE,
    LEFT,
    RIGHT,
    SENSOR,
    ProtocolWay,
    open_plant,
)
from services.operator.bench.protocols.scoring_day import truth_lines

HOLE_SEED = 1000


TOLD = (  # facts beyond the page that the user must know here
    f"arm {ARM} (RTDE), sensor {SENSOR} (Net F/T), cameras {LEFT} and {RIGHT} (GigE Vision): the page's addresses,",
    "in a network of this command alone. Beside what the page says, the cell's file needs here:",
    *yaml.safe_dump({"hardware": HERE}, sort_keys=False).splitlines(),
    "The board: python -m services.operator.bench.protocols.board hand | flange | away",
)


def practise(
    command: Annotated[
        list[str] | None, typer.Argument(help="Run there, all ends with it; your shell when left out.")
    ] = None,
    hidden: Annotated[int, typer.Option(min=0, help="Draws the differences between the cell and its file.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Draws where the hole is.")] = HOLE_SEED,
    tell: Annotated[bool, typer.Option("--tell", help="At the end: what was hidden.")] = False,
) -> None:
    """A UR5e, an ATI sensor and two cameras without any of them: their other ends speak the devices' protocols at the
    addresses of docs/hardware/in-a-day.md, in a network of its own, and the cell behind them is not as its file says.
    Without a terminal and a command it stays until it is ended."""
    console = Console(stderr=True)
    with errors_shown(console), tempfile.TemporaryDirectory(prefix="crosspih-practise-") as folder:
        private_network(ADDRESSES)
        console.print("starting the devices' other ends", highlight=False)
        with _Stopping() as stop, open_plant(ProtocolWay.UR, seed, Path(folder), hidden) as plant:
            console.print("\n".join(TOLD), highlight=False, markup=False, soft_wrap=True)
            shell = [os.environ.get("SHELL") or "sh"] if sys.stdin.isatty() else []
            status = _run([*(command or shell)], stop)
            if tell:
                console.print("\n".join(truth_lines(plant.behind)), highlight=False, markup=False)
        if status:
            raise typer.Exit(status)


class _Stopping:
    """SIGTERM and SIGINT set an event: the peers are ended in order."""

    def __enter__(self) -> threading.Event:
        self._event = threading.Event()

        def on_signal(number: int, frame: FrameType | None) -> None:
            self._event.set()

        self._before = {number: signal.signal(number, on_signal) for number in (signal.SIGINT, signal.SIGTERM)}
        return self._event

    def __exit__(self, *exc: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)


def _run(words: list[str], stop: threading.Event) -> int:
    if not words:
        print(f"until Ctrl-C; another terminal comes in by: nsenter -n -t {os.getpid()}", file=sys.stderr, flush=True)
        while not stop.wait(0.5):
            pass
        return 0
    try:
        child = subprocess.Popen(words)
    except OSError as error:
        print(f"{words[0]}: {error.strerror}", file=sys.stderr)
        return 127
    while True:
        try:
            return child.wait(0.5)
        except subprocess.TimeoutExpired:
            if stop.is_set() and not sys.stdin.isatty():
                child.terminate()
