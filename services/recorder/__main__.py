"""`python -m services.recorder`: records when asked to."""

from __future__ import annotations

from crosspih_common.service import ServiceContext, run_service
from crosspih_common.service.ending import end_process
from services.recorder.config import RecorderConfig
from services.recorder.shell import RecorderShell


def build(context: ServiceContext, config: RecorderConfig) -> RecorderShell:
    """Tap every key and serve start and stop."""
    return RecorderShell(context, config)


if __name__ == "__main__":
    end_process(run_service("recorder", RecorderConfig, build))
