"""The detached supervisor, started by stack.start_stack: ``python -m deploy.launcher <request as JSON>``."""

import sys

from deploy.launcher.errors import LauncherError
from deploy.launcher.foreground import supervise
from deploy.launcher.stack import StackRequest


def main() -> int:
    """Supervise until stopped; what cannot be started is said in one line on standard error."""
    try:
        return supervise(StackRequest.from_json(sys.argv[1]), show=lambda _line: None)
    except LauncherError as error:
        print(error, file=sys.stderr, flush=True)
        return 1


if __name__ == "__main__":
    sys.exit(main())
