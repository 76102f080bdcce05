"""What the launcher refuses, each with the field it is about and how to mend it.

LauncherError
|- ComposeError      the compose file or the choice of services is wrong
|- AlreadyUpError    a supervisor of this project runs already
|- NotUpError        no supervisor of this project runs
'- StartError        the stack did not come up
"""

from dataclasses import dataclass

from crosspih_common.errors import CrosspihError


@dataclass(frozen=True)
class Fault:
    """One fault in a compose file: ``field`` as a dotted path, what is wrong, and what to write instead."""

    field: str
    problem: str
    mend: str

    def __str__(self) -> str:
        return f"{self.field}: {self.problem}; {self.mend}"


class LauncherError(CrosspihError):
    """Anything the launcher refuses; the message is for the user as it stands."""


class ComposeError(LauncherError):
    """The compose file, or the choice of services from it, is wrong; ``faults`` holds every fault found."""

    def __init__(self, source: str, faults: list[Fault]) -> None:
        self.source = source
        self.faults = tuple(faults)
        super().__init__("\n".join(f"{source}: {fault}" for fault in faults))


class AlreadyUpError(LauncherError):
    """A supervisor of this project runs already."""


class NotUpError(LauncherError):
    """No supervisor of this project runs."""


class StartError(LauncherError):
    """The stack did not come up; the message ends with what the supervisor or the service last said."""
