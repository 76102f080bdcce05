"""Every error that crosspih raises on purpose.

CrosspihError
├── ConfigError            a configuration file says something that cannot be
├── BusError
│   ├── BusUnreachable     no router answers at the endpoint
│   ├── ContractError      a sample is not what its key promises (type, version, fields)
│   ├── NoService          nobody serves the command, or whoever did vanished without a word
│   │   └── NotSent        nobody served it, so it was not even sent: it may be asked again
│   ├── CommandTimeout     the service did not answer within the deadline
│   └── BusClosed          the bus was closed while it was in use
└── CommandRefused         the service answered: no, and why (`code` for programs, text for people)
    └── DeviceLost         a device no longer answers, or says that it may not move
"""

from __future__ import annotations


class CrosspihError(Exception):
    """Something crosspih expected might go wrong, did. `code` is how a service refuses that met it on its way.

    `field` and `mend` are what the text is about and what would mend it, for programs; empty where nobody said.
    """

    code: str = "internal"

    def __init__(self, *text: object, field: str = "", mend: str = "") -> None:
        super().__init__(*text)
        self.field, self.mend = field, mend


CONFIG_STATUS = 78  # how a service ends that cannot read its settings (EX_CONFIG): another start would not mend it


class ConfigError(CrosspihError):
    """A configuration file says something that cannot be; names the field and the mend."""

    code = "config"


class BusError(CrosspihError):
    """Something between two services went wrong."""


class BusUnreachable(BusError):
    """No router answers at the endpoint."""

    code = "bus_unreachable"


class ContractError(BusError):
    """A sample is not what its key promises: wrong type, wrong version, or fields that do not validate."""

    code = "bad_answer"


class NoService(BusError):
    """Nobody serves the command, or whoever did vanished without a word."""

    code = "no_service"


class NotSent(NoService):
    """Nobody serves the command, also when waited for: it was not sent, and may be asked again."""


class CommandTimeout(BusError):
    """The service did not answer within the deadline."""

    code = "command_timeout"


class BusClosed(BusError):
    """The bus was closed while it was in use."""


STOPPING = "stopping"  # the code of a refusal by a service that was ended in order while it carried the command out


class CommandRefused(CrosspihError):
    """The service answered no. `code` is stable and for programs; the text says why and what would mend it."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(f"{code}: {text}")
        self.code = code
        self.text = text


class DeviceLost(CommandRefused):
    """A device no longer answers, or says that it may not move; the text says which, why, and what mends it.

    Raised by drivers. The arm's loop goes on asking; what was under way has ended, and nothing is remembered of it.
    """

    def __init__(self, text: str) -> None:
        super().__init__("device_lost", text)
