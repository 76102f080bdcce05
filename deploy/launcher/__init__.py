"""Runs a compose file as local processes: no containers, no root, the same on Linux and macOS.

Pure core: compose (the model), interpolation, loading, order, conditions, restart, health. Shell: process, guard and
tethered_exec (children that cannot outlive us), notify_socket, monitoring, supervisor, state, stack, cli.
"""

from deploy.launcher.errors import AlreadyUpError, ComposeError, LauncherError, NotUpError, StartError
from deploy.launcher.process import tethered
from deploy.launcher.stack import DEFAULT_COMPOSE_FILE, StackRequest, is_up, start_stack, stop_stack
from deploy.launcher.state import DEFAULT_PROJECT, ServiceState, StackState, StateDirectory

__all__ = [
    "DEFAULT_COMPOSE_FILE",
    "DEFAULT_PROJECT",
    "AlreadyUpError",
    "ComposeError",
    "LauncherError",
    "NotUpError",
    "ServiceState",
    "StackRequest",
    "StackState",
    "StartError",
    "StateDirectory",
    "is_up",
    "start_stack",
    "stop_stack",
    "tethered",
]
