"""Cells wherever Ray has a core: an actor each, on this machine or on all of a cluster."""

from __future__ import annotations

import contextlib
from typing import Any

from crosspih_common.errors import ConfigError
from crosspih_common.provenance import code_version
from services.operator.bench.cells.own_cell import CellTask
from services.operator.bench.cells.worker import CellWorker, Outcome

_END_S = 20.0


def _ray() -> Any:
    try:
        import ray
    except ImportError:
        raise ConfigError(
            "--executor ray: Ray is not installed; install the extra: pip install 'crosspih[ray]'"
        ) from None
    return ray


class _Actor:
    """A worker in a process of Ray's."""

    def __init__(self, index: int) -> None:
        self._worker = CellWorker(index)

    def code_version(self) -> str:
        """The version of the code that is installed where this actor runs."""
        return code_version()

    def run(self, task: CellTask) -> Outcome:
        """Do a task."""
        return self._worker.run(task)

    def close(self) -> None:
        """Stop the cell."""
        self._worker.close()


class RayExecutor:
    """Implements Executor with Ray's actors, one core each. `address` names a running cluster; without one, Ray is
    started for this process, on the loopback interface only. Without `cells`, there is one per core that Ray has.

    Raises ConfigError when Ray is missing, the cluster cannot be reached, or one of its machines has other code.
    """

    def __init__(self, cells: int | None, address: str | None = None) -> None:
        self._ray = ray = _ray()
        options: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
        if address is None:
            options |= {"include_dashboard": False, "_node_ip_address": "127.0.0.1"}
            if cells is not None:
                options["num_cpus"] = cells
        try:
            ray.init(address=address, **options)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise ConfigError(f"--ray-address {address}: {error}") from None
        try:
            count = cells if cells is not None else max(1, int(ray.cluster_resources().get("CPU", 1)))
            self._class = ray.remote(num_cpus=1)(_Actor)
            self._actors = [self._class.remote(index) for index in range(count)]
            self._check_code()
        except BaseException:
            ray.shutdown()
            raise
        self._running: dict[int, Any] = {}

    def _check_code(self) -> None:
        here = code_version()
        for there in self._ray.get([actor.code_version.remote() for actor in self._actors]):
            if there != here:
                raise ConfigError(
                    f"--executor ray: a machine of the cluster has other code ({there}, here {here}); install the same "
                    f"version on all"
                )

    @property
    def cells(self) -> int:
        """How many cells there are."""
        return len(self._actors)

    def submit(self, cell: int, task: CellTask) -> None:
        """Give an idle cell a task."""
        self._running[cell] = self._actors[cell].run.remote(task)

    def wait(self, busy: list[int], timeout_s: float) -> list[tuple[int, Outcome]]:
        """The outcomes that have come from busy cells; an actor that died is replaced and its task is lost."""
        of = {self._running[cell]: cell for cell in busy}
        ready, _ = self._ray.wait(list(of), num_returns=1, timeout=timeout_s)
        found: list[tuple[int, Outcome]] = []
        for reference in ready:
            cell = of[reference]
            try:
                outcome = self._ray.get(reference)
            except self._ray.exceptions.RayError as error:
                self._actors[cell] = self._class.remote(cell)
                outcome = Outcome(lost=f"its actor ended: {str(error).splitlines()[0]}")
            found.append((cell, outcome))
        return found

    def close(self) -> None:
        """Stop every cell, and Ray where it was started here."""
        # a busy actor is killed instead, and the lifeline stops its stack
        with contextlib.suppress(self._ray.exceptions.RayError):
            ended = [actor.close.remote() for cell, actor in enumerate(self._actors)]
            self._ray.wait(ended, num_returns=len(ended), timeout=_END_S)
        for actor in self._actors:
            with contextlib.suppress(self._ray.exceptions.RayError):
                self._ray.kill(actor)
        self._ray.shutdown()
