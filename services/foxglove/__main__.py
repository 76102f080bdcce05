"""`python -m services.foxglove`: an optional service; `crosspih foxglove` runs it beside a stack."""

from __future__ import annotations

from crosspih_common.service import ServiceContext, run_service
from crosspih_common.service.ending import end_process
from services.foxglove.config import FoxgloveConfig
from services.foxglove.shell import FoxgloveShell


def build(context: ServiceContext, config: FoxgloveConfig) -> FoxgloveShell:
    """Open the WebSocket and bind it to the bus."""
    return FoxgloveShell(context, config.by_environment())


if __name__ == "__main__":
    end_process(run_service("foxglove", FoxgloveConfig, build))
