"""Trials on hosts: starts the stack, requests each assembly on the planner's host, and sets the network
for each trial.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from crosspih_common.errors import CrosspihError
from services.operator.bench.cells.conditions import Condition, cell_content
from services.operator.bench.cells.own_cell import content_for
from services.operator.bench.cells.trials import base_cell_text
from services.operator.bench.reliability.hosts.network import Network
from services.operator.bench.reliability.hosts.observe import HostObservation
from services.operator.bench.reliability.hosts.plan import CUT_AFTER_S, CUT_AT, Trial
from services.operator.bench.reliability.hosts.recorded import RecordingFigures, kept
from services.operator.bench.reliability.hosts.stacks import COMPUTE, Stacks, stacks_up

OBSERVE = "services.operator.bench.reliability.hosts.observe"


class HostTrial(BaseModel):
    """One trial: its observation, the figures of its recording, and packets passed, lost and cut meanwhile."""

    trial: str
    hosts: int
    seen: HostObservation
    kept: RecordingFigures
    packets: dict[str, int]


def cell_text(holder_timeout_s: float | None, folder: Path) -> str:
    """The cell's file, with another holder time-out of the arm where one is set, and with all its files
    in the folder.
    """
    overrides: dict[str, Any] = {"recorder": {"directory": str(folder / "recordings")}}
    if holder_timeout_s is not None:
        overrides["hardware"] = {"limits": {"holder_timeout_s": holder_timeout_s}}
    content = cell_content(base_cell_text(), Condition(name="hosts", overrides=overrides))
    return yaml.safe_dump(content_for(content, "hosts", folder), sort_keys=False)


def run_on_one_stack(
    trials: Sequence[Trial],
    folder: Path,
    seed: int,
    speed: str,
    say: Callable[[str], None],
    done: Callable[[HostTrial], None],
) -> None:
    """Calls `done` with each trial's row. Raises NoNetwork, NoService."""
    hosts = trials[0].hosts
    cell = folder / "cell.yaml"
    cell.write_text(cell_text(trials[0].holder_timeout_s, folder), encoding="utf-8")
    with Network({host.name: host.address for host in hosts}) as network:
        say(f"{len(hosts)} hosts: bringing the stack up")
        with stacks_up(network, hosts, folder, cell, speed, secure=len(hosts) > 1) as stacks:
            for trial in trials:
                say(f"{trial.name}: assembling")
                done(_run(trial, network, stacks, seed))


def _cut(network: Network, host: str, cut_s: float) -> None:
    time.sleep(CUT_AFTER_S)
    network.become(out=[host])
    time.sleep(cut_s)
    network.become()


def _run(trial: Trial, network: Network, stacks: Stacks, seed: int) -> HostTrial:
    before = network.become(trial.delay_s, trial.loss)
    asker = COMPUTE.name if len(trial.hosts) > 1 else trial.hosts[0].name
    process = stacks.start(asker, OBSERVE, str(seed))
    seen: HostObservation | None = None
    cutting: threading.Thread | None = None
    assert process.stdout is not None and process.stderr is not None
    # read on a thread of its own: a full pipe would block the process
    wrong: list[str] = []
    reader = threading.Thread(target=lambda: wrong.append(process.stderr.read()), daemon=True)  # type: ignore[union-attr]
    reader.start()
    for line in process.stdout:
        said: dict[str, Any] = json.loads(line)
        if "seen" in said:
            seen = HostObservation.model_validate(said["seen"])
        elif said.get("step") == CUT_AT and trial.cut_s and cutting is None:
            cutting = threading.Thread(target=_cut, args=(network, asker, trial.cut_s), name="cutting")
            cutting.start()
    process.wait()
    reader.join()
    process.stdout.close()
    process.stderr.close()
    if cutting is not None:
        cutting.join()
    after = network.become()
    if seen is None:
        raise CrosspihError(f"{trial.name}: the assembly could not even be asked for: {''.join(wrong)[-1000:]}")
    packets = {name: after[name] - before[name] for name in after}
    return HostTrial(trial=trial.name, hosts=len(trial.hosts), seen=seen, kept=kept(seen.recording), packets=packets)
