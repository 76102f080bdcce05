"""`python -m services.ros2`: an optional service; `crosspih up --profile ros2` starts it with the others."""

from __future__ import annotations

from crosspih_common.service import ServiceContext, run_service
from crosspih_common.service.ending import end_process
from services.ros2.config import BridgeConfig
from services.ros2.shell import BridgeShell


def build(context: ServiceContext, config: BridgeConfig) -> BridgeShell:
    """Open the node and bind it to the bus."""
    return BridgeShell(context, config)


if __name__ == "__main__":
    end_process(run_service("ros2", BridgeConfig, build))
