"""`python -m services.inference`."""

from __future__ import annotations

import sys

from crosspih_common.service import ServiceContext, run_service
from services.inference.config import InferenceConfig
from services.inference.shell import InferenceShell


def build(context: ServiceContext, config: InferenceConfig) -> InferenceShell:
    """Bind the core to its keys."""
    return InferenceShell(context, config)


if __name__ == "__main__":
    sys.exit(run_service("inference", InferenceConfig, build))
