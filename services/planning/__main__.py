"""`python -m services.planning`."""

from __future__ import annotations

from crosspih_common.service import ServiceContext, run_service
from crosspih_common.service.ending import end_process
from services.planning.config import PlanningConfig
from services.planning.shell import PlanningShell


def build(context: ServiceContext, config: PlanningConfig) -> PlanningShell:
    """Bind the core to its keys."""
    return PlanningShell(context, config)


if __name__ == "__main__":
    end_process(run_service("planning", PlanningConfig, build))
