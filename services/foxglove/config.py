"""The section `foxglove` of a cell's file."""

from __future__ import annotations

import ipaddress
import os

from pydantic import Field, ValidationError

from crosspih_common.config import Section
from crosspih_common.errors import ConfigError

HOST, PORT = "CROSSPIH_FOXGLOVE_HOST", "CROSSPIH_FOXGLOVE_PORT"


class FoxgloveConfig(Section):
    """Where viewers connect, and how much data they get."""

    host: str = Field(
        default="127.0.0.1", description=f"whoever reaches it sees all, and commands nothing; {HOST} goes before it"
    )
    port: int = Field(default=8765, ge=0, le=65535, description=f"0: any that is free; {PORT} goes before it")
    rate_hz: float = Field(default=50.0, gt=0.0, le=500.0, description="of frames and joints")
    backlog: int = Field(default=4096, ge=16, description="messages that wait for one viewer; then the oldest are lost")

    def by_environment(self) -> FoxgloveConfig:
        """With what the environment says. Raises ConfigError."""
        said = {"host": os.environ.get(HOST), "port": os.environ.get(PORT)}
        try:
            return type(self).model_validate({**self.model_dump(), **{name: one for name, one in said.items() if one}})
        except ValidationError as error:
            raise ConfigError(f"{HOST}, {PORT}: {error.errors()[0]['msg']}") from None

    def is_open_to_others(self) -> bool:
        """Whether other machines may reach it."""
        try:
            return not ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host != "localhost"
