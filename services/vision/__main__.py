"""`python -m services.vision`."""

from __future__ import annotations

import sys

from crosspih_common.service import ServiceContext, run_service
from services.vision.config import VisionConfig
from services.vision.shell import VisionShell


def build(context: ServiceContext) -> VisionShell:
    """Bind the core to its keys."""
    return VisionShell(context, context.cell.section("vision", VisionConfig))


if __name__ == "__main__":
    sys.exit(run_service("vision", build))
