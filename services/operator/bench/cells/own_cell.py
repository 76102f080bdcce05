"""A cell that belongs to a worker: its stack, its router, its key prefix, and a sensor calibrated the same way every
time.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

import deploy
from crosspih_common.config import load_cell
from crosspih_common.errors import CrosspihError, NoService
from crosspih_common.messages import ResetCell
from crosspih_common.modules import module_command
from deploy.launcher import LauncherError, StackRequest, StateDirectory, start_stack, stop_stack
from services.operator.assembly.session import NEEDED, Session

SPEEDS = ("realtime", "max")  # the speeds at which a stack can be started
START_DEADLINE_S = 120.0
CALIBRATION_SEED = 0
CALIBRATION_DWELL_S = 0.25
_LOG_LINES = 6


@dataclass(frozen=True)
class CellTask:
    """A task to do in a cell.

    `work(session, payload)` runs in the worker's process: a function of a module, with a result that can be pickled.
    `content` is the cell's file as a mapping; tasks with equal contents and services share a stack. With `calibrate`
    the F/T sensor is calibrated when the stack has come up, always from the same seed. `speed` is max or realtime, or
    empty for a cell whose hardware has no clock, such as cameras alone.
    """

    label: str
    content: dict[str, Any]
    work: Callable[[Session, Any], Any]
    payload: Any
    services: tuple[str, ...] = NEEDED
    calibrate: bool = True
    speed: str = "max"

    def same_cell(self, other: CellTask | None) -> bool:
        """Whether both can be done in one cell."""
        return other is not None and (self.content, self.services, self.calibrate, self.speed) == (
            other.content, other.services, other.calibrate, other.speed,
        )  # fmt: skip


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of 127.0.0.1 that is free now."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def content_for(content: dict[str, Any], name: str, folder: Path) -> dict[str, Any]:
    """The cell's file for a cell of this name, which keeps its calibration in a separate folder."""
    cell = dict(content.get("cell") or {})
    force_torque = dict(content.get("force_torque") or {})
    cell["name"] = name
    force_torque["calibration_file"] = str(folder / "ft-calibration.yaml")
    return {**content, "cell": cell, "force_torque": force_torque}


class OwnCell:
    """One stack at the task's speed, from `start` to `close`. It sets the process's CROSSPIH_ variables.

    A helper process holds a pipe from this one: if this one is killed, the helper stops the stack.
    """

    def __init__(self, index: int, task: CellTask) -> None:
        self._task = task
        self._name = f"bench-{index}"
        self._folder = Path(tempfile.mkdtemp(prefix="crosspih-bench-"))
        self._request = StackRequest(
            project=self._name, services=("router", *task.services), run_root=self._folder / "run"
        )
        self._lifeline: subprocess.Popen[bytes] | None = None
        self._session: Session | None = None

    def start(self) -> Session:
        """Bring the stack up and calibrate. Raises CrosspihError or LauncherError; the cell is closed then."""
        try:
            return self._start()
        except BaseException:
            self.close()
            raise

    def _start(self) -> Session:
        path = self._folder / "cell.yaml"
        content = content_for(self._task.content, self._name, self._folder)
        path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        # report errors of the file here once, not by five services
        load_cell(path)
        root = str(Path(deploy.__file__).resolve().parent.parent)
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        os.environ.update(CROSSPIH_CELL=str(path), CROSSPIH_ENDPOINT=endpoint, CROSSPIH_SPEED=self._task.speed)
        # for the work to find the stack's state
        os.environ["CROSSPIH_RUN_DIR"] = str(self._folder / "run")
        os.environ["PYTHONPATH"] = os.pathsep.join(
            dict.fromkeys([root, *os.environ.get("PYTHONPATH", root).split(":")])
        )
        self._lifeline = subprocess.Popen(
            module_command("services.operator.bench.cells.lifeline", self._name, str(self._folder)),
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        start_stack(self._request, True, START_DEADLINE_S)
        self._session = session = Session()
        session.wait_for_services(START_DEADLINE_S, self._task.services)
        if "hardware" in self._task.services and self._task.speed and session.speed() != self._task.speed:
            raise NoService(f"hardware: the cell came up at {session.speed()}, wanted {self._task.speed}")
        if self._task.calibrate:
            session.new_trial(ResetCell(seed=CALIBRATION_SEED))
            session.calibrate_ft(CALIBRATION_DWELL_S)
        return session

    def last_words(self) -> str:
        """The last lines of the log of each service that logged an error; empty when none did."""
        said = []
        for service, tail in StateDirectory(self._name, self._folder / "run").tails().items():
            lines = [line.text for line in tail.read()]
            if any("error" in line.lower() for line in lines):
                said.append(f"{service}: " + " / ".join(lines[-_LOG_LINES:]))
        return "; ".join(said)

    def close(self) -> None:
        """Stop the stack and remove what it wrote; a second call does nothing."""
        if self._session is not None:
            self._session.bus.close()
            self._session = None
        # a stack that is already gone needs no stop
        with contextlib.suppress(CrosspihError, LauncherError):
            stop_stack(self._name, self._folder / "run")
        # once the folder is removed the lifeline has nothing to do
        shutil.rmtree(self._folder, ignore_errors=True)
        if self._lifeline is not None:
            assert self._lifeline.stdin is not None
            self._lifeline.stdin.close()
            self._lifeline.wait()
            self._lifeline = None
