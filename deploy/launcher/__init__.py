"""Runs a compose file as local processes: no containers, no root, the same on Linux and macOS.

Pure core: compose (the model), interpolation, loading, order, conditions, restart, health. Shell: process, guard and
tethered_exec (children that cannot outlive us), notify_socket, monitoring, supervisor, state, stack, cli.
"""

from typing import TYPE_CHECKING

from crosspih_common.modules import on_demand

if TYPE_CHECKING:
    from deploy.launcher.errors import AlreadyUpError, ComposeError, LauncherError, NotUpError, StartError
    from deploy.launcher.process import tethered
    from deploy.launcher.stack import DEFAULT_COMPOSE_FILE, StackRequest, is_up, start_stack, stop_stack
    from deploy.launcher.state import DEFAULT_PROJECT, ServiceRow, StackState, StateDirectory
else:
    _MODULES = {
        "AlreadyUpError": "errors",
        "ComposeError": "errors",
        "DEFAULT_COMPOSE_FILE": "stack",
        "DEFAULT_PROJECT": "state",
        "LauncherError": "errors",
        "NotUpError": "errors",
        "ServiceRow": "state",
        "StackRequest": "stack",
        "StackState": "state",
        "StartError": "errors",
        "StateDirectory": "state",
        "is_up": "stack",
        "start_stack": "stack",
        "stop_stack": "stack",
        "tethered": "process",
    }
    __getattr__ = on_demand(__name__, _MODULES)  # whoever looks at a stack need not load what starts one


__all__ = [
    "DEFAULT_COMPOSE_FILE",
    "DEFAULT_PROJECT",
    "AlreadyUpError",
    "ComposeError",
    "LauncherError",
    "NotUpError",
    "ServiceRow",
    "StackRequest",
    "StackState",
    "StartError",
    "StateDirectory",
    "is_up",
    "start_stack",
    "stop_stack",
    "tethered",
]
