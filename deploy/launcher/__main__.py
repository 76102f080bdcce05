"""The detached supervisor, started by stack.start_stack: ``python -m deploy.launcher <request as JSON>``."""

import sys

from deploy.launcher.errors import LauncherError
from deploy.launcher.foreground import supervise
from deploy.launcher.logfile import LogLine
from deploy.launcher.stack import StackRequest
from deploy.launcher.supervisor import SUPERVISOR


def _show(line: LogLine) -> None:
    """What a service wrote is in its log; what is about the stack as a whole goes to the supervisor's."""
    if line.service == SUPERVISOR:
        print(f"{line.time} {line.text}", file=sys.stderr, flush=True)


def main() -> int:
    """Supervise until stopped; what cannot be started is said in one line on standard error."""
    try:
        return supervise(StackRequest.from_json(sys.argv[1]), _show)
    except LauncherError as error:
        print(error, file=sys.stderr, flush=True)
        return 1


if __name__ == "__main__":
    sys.exit(main())
