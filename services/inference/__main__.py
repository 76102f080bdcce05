"""`python -m services.inference`."""

from __future__ import annotations

from crosspih_common.service import ServiceContext, run_service
from crosspih_common.service.ending import end_process
from services.inference.config import InferenceConfig
from services.inference.shell.service import InferenceShell


def build(context: ServiceContext, config: InferenceConfig) -> InferenceShell:
    """Bind the core to its keys."""
    return InferenceShell(context, config)


if __name__ == "__main__":
    end_process(run_service("inference", InferenceConfig, build))
