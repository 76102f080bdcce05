"""Every error that crosspih raises on purpose.

CrosspihError
├── ConfigError            a configuration file has an invalid setting
├── BusError
│   ├── BusUnreachable     no router answers at the endpoint
│   ├── ContractError      a sample is not what its key promises (type, version, fields)
│   ├── NoService          no service serves the command, or its server ended without an answer
│   │   └── NotSent        no service served it, so it was not sent: it may be sent again
│   ├── CommandTimeout     the service did not answer within the deadline
│   └── BusClosed          the bus was closed while it was in use
└── CommandRefused         the service refused the command and says why (`code` for programs, text for people)
    └── DeviceLost         a device no longer answers, or reports that it may not move
"""

from __future__ import annotations


class CrosspihError(Exception):
    """An error that crosspih foresees. `code` is the refusal code of a service that meets it during a command.

    `field` and `mend` name the setting concerned and how to correct it, for programs; they may be empty.
    """

    code: str = "internal"

    def __init__(self, *text: object, field: str = "", mend: str = "") -> None:
        super().__init__(*text)
        self.field, self.mend = field, mend


CONFIG_STATUS = 78  # exit status of a service with invalid settings (EX_CONFIG): a restart would not help


class ConfigError(CrosspihError):
    """A configuration file has an invalid setting; the text names the field and how to correct it."""

    code = "config"


class BusError(CrosspihError):
    """An error of the communication between two services."""


class BusUnreachable(BusError):
    """No router answers at the endpoint."""

    code = "bus_unreachable"


class ContractError(BusError):
    """A sample does not match its key: wrong type, wrong version, or fields that do not validate."""

    code = "bad_answer"


class NoService(BusError):
    """No service serves the command, or its server ended without an answer."""

    code = "no_service"


class NotSent(NoService):
    """No service served the command within the wait: it was not sent, and may be sent again."""


class CommandTimeout(BusError):
    """The service did not answer within the deadline."""

    code = "command_timeout"


class BusClosed(BusError):
    """The bus was closed while it was in use."""


STOPPING = "stopping"  # the refusal code of a service that was stopped in order while it carried out the command


class CommandRefused(CrosspihError):
    """The service refused the command. `code` is stable and for programs; the text says why and how to correct it."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(f"{code}: {text}")
        self.code = code
        self.text = text


class DeviceLost(CommandRefused):
    """A device no longer answers, or reports that it may not move; the text says which, why, and what to do.

    Raised by drivers. The arm's loop keeps polling the device; a motion under way has ended and is not resumed.
    """

    def __init__(self, text: str) -> None:
        super().__init__("device_lost", text)
