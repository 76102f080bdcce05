"""Vision as a separate process that takes lines of JSON: the operator imports none of its code."""

from __future__ import annotations

import json
import os
import subprocess
from types import TracebackType
from typing import Any

from crosspih_common.errors import CrosspihError
from crosspih_common.modules import module_command

LOCATING = "services.vision.offline"
# as deploy/compose.yaml starts the service: the fit's matrices are so small that more threads only wait for each other
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class BadInput(CrosspihError):
    """An input that cannot be used; the text names the field and the remedy."""


class VisionLost(CrosspihError):
    """The process ended, or its answer could not be read."""


class OfflineVision:
    """The process; started at once, ended with the context. `module` is vision's tool; others do more than locating."""

    def __init__(self, module: str = LOCATING) -> None:
        self._process = subprocess.Popen(
            module_command(module), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8",
            env={**ONE_THREAD, **os.environ},
        )  # fmt: skip

    def __enter__(self) -> OfflineVision:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def ask(self, job: dict[str, Any]) -> dict[str, Any]:
        """The answer to one job (fields: see the module's docstring). Raises BadInput, VisionLost."""
        source, sink = self._process.stdout, self._process.stdin
        assert source is not None and sink is not None
        try:
            sink.write(json.dumps(job) + "\n")
            sink.flush()
            line = source.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            raise VisionLost(
                f"the vision process ended with status {self._process.wait()}; what it printed stands above. Is the "
                "extra `vision` installed?"
            )
        try:
            answer = json.loads(line)
        except ValueError:
            raise VisionLost(f"the vision process answered {line[:80]!r}, which is no JSON") from None
        if not isinstance(answer, dict):
            raise VisionLost(f"the vision process answered {line[:80]!r}, which is no object")
        if "error" in answer:
            raise BadInput(f"{answer['error']['field']}: {answer['error']['text']}")
        return answer

    def close(self) -> None:
        """End the process; a second call does nothing."""
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()
        self._process.wait()
