"""`python -m services.vision`."""

from __future__ import annotations

from crosspih_common.service import ServiceContext, run_service
from crosspih_common.service.ending import end_process
from services.vision.config import VisionConfig
from services.vision.shell import VisionShell


def build(context: ServiceContext, config: VisionConfig) -> VisionShell:
    """Bind the core to its keys."""
    return VisionShell(context, config)


if __name__ == "__main__":
    end_process(run_service("vision", VisionConfig, build))
