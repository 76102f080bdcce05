"""`python -m services.force_torque`."""

from __future__ import annotations

from crosspih_common.service import ServiceContext, run_service
from crosspih_common.service.ending import end_process
from services.force_torque.config import ForceTorqueConfig
from services.force_torque.shell import ForceTorqueShell


def build(context: ServiceContext, config: ForceTorqueConfig) -> ForceTorqueShell:
    """Bind the core to its keys."""
    return ForceTorqueShell(context, config)


if __name__ == "__main__":
    end_process(run_service("force_torque", ForceTorqueConfig, build))
