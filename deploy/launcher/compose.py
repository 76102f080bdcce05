"""The part of the Compose specification that makes sense for local processes, as a strict model.

Every key means what it means in Compose, except where a process is not a container: a process inherits the launcher's
environment, ``working_dir`` is relative to the compose file's folder (and defaults to it), ``python`` as a command's
first word is the interpreter that runs the launcher, and ``stop_grace_period`` defaults to 2 s. Our own keys:

    x-notify: true      the service is healthy once it sent ``READY=1`` (see crosspih_common.service.notify)
    x-watchdog_s: 5     and unhealthy when no ``WATCHDOG=1`` came for this many seconds
    x-up_where_installed: viser   ``crosspih up`` of the whole file starts it, its profile asked for or not, where this
                        Python module is installed
    x-working_dir: ..   as ``working_dir``, which a container engine would take for a folder in the container

The same file may be for a container engine too: the keys of ENGINE_KEYS and ENGINE_SECTIONS are its alone, and are left
alone here. So is the ``healthcheck`` of a service with ``x-notify``, whose notification says more and sooner.
"""

import re
import shlex
from importlib.util import find_spec
from typing import Annotated, Any

from pydantic import AliasChoices, BaseModel, BeforeValidator, ConfigDict, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from deploy.launcher.conditions import StartCondition
from deploy.launcher.restart import RestartPolicy, RestartWhen

_DURATION_PART = re.compile(r"(\d+(?:\.\d+)?)(us|ms|s|m|h|d)")
_SECONDS = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}
# Of a service, and at the top: what makes sense for a container, and changes nothing for a local process.
ENGINE_KEYS = frozenset(
    {"build", "cap_add", "cap_drop", "container_name", "devices", "hostname", "image", "init", "ipc", "labels"}
    | {"logging", "network_mode", "platform", "pull_policy", "read_only", "security_opt", "shm_size", "tmpfs"}
    | {"ulimits", "user", "userns_mode", "volumes"}
)
ENGINE_SECTIONS = frozenset({"volumes"})
_NAME = r"^[a-zA-Z0-9][a-zA-Z0-9._-]*$"


def _refuse(problem: str, mend: str) -> PydanticCustomError:
    return PydanticCustomError("compose", "{problem}", {"problem": problem, "mend": mend})


def parse_duration_s(value: object) -> float:
    """Seconds of a Compose duration such as ``500ms``, ``1m30s`` or ``2s``."""
    parts = _DURATION_PART.findall(value) if isinstance(value, str) else []
    if not parts or "".join(number + unit for number, unit in parts) != value:
        raise _refuse(f"{value!r} is not a duration", "write a number with a unit, such as 500ms, 2s or 1m30s")
    return sum(float(number) * _SECONDS[unit] for number, unit in parts)


def _parse_command(value: object) -> object:
    if isinstance(value, str):
        try:
            value = shlex.split(value)
        except ValueError as error:
            raise _refuse(
                f"{value!r} cannot be split: {error}", "close the quotes, or write a list of words"
            ) from error
    if not isinstance(value, list) or not value:
        raise _refuse("no command", "write a line, or a list of words, such as [python, -m, services.router]")
    return tuple(str(word) if isinstance(word, int | float) and not isinstance(word, bool) else word for word in value)


def _parse_environment(value: object) -> object:
    """Compose's two forms; None as a value passes the launcher's own variable through, if it is set."""
    if isinstance(value, list):
        pairs: dict[str, object] = {}
        for entry in value:
            name, equals, text = str(entry).partition("=")
            pairs[name] = text if equals else None
        return pairs
    if isinstance(value, dict):
        for name, entry in value.items():
            if isinstance(entry, bool):
                raise _refuse(f"{name} is a YAML boolean", f'quote it: {name}: "{str(entry).lower()}"')
        return {name: str(entry) if isinstance(entry, int | float) else entry for name, entry in value.items()}
    return value


def _parse_dependencies(value: object) -> object:
    return {str(name): {} for name in value} if isinstance(value, list) else value


def _parse_restart(value: object) -> object:
    if isinstance(value, RestartPolicy):
        return value
    # YAML reads a bare no as false.
    text = "no" if value is False else value
    try:
        return RestartPolicy.parse(text) if isinstance(text, str) else RestartPolicy.parse(str(text))
    except ValueError as error:
        raise _refuse(
            f"{value!r} is not a restart policy", 'write "no", always, on-failure, on-failure:3 or unless-stopped'
        ) from error


Duration = Annotated[float, BeforeValidator(parse_duration_s)]
Command = Annotated[tuple[str, ...], BeforeValidator(_parse_command)]
Environment = Annotated[dict[str, str | None], BeforeValidator(_parse_environment)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True)


class Dependency(_Part):
    """One entry of ``depends_on``; one that is not required is waited for only if it is among the services run."""

    condition: StartCondition = StartCondition.STARTED
    required: bool = True


class Healthcheck(_Part):
    """A command whose exit status 0 means healthy; ``test`` is the argument vector, empty if switched off.

    Accepts Compose's forms: a string or ``[CMD-SHELL, line]`` run by the shell, ``[CMD, word, ...]``, ``[NONE]``.
    """

    test: tuple[str, ...] = ()
    interval: Duration = 30.0
    timeout: Duration = 30.0
    retries: int = Field(default=3, ge=1)
    start_period: Duration = 0.0
    start_interval: Duration = 5.0
    disable: bool = False

    @field_validator("test", mode="before")
    @classmethod
    def _argument_vector(cls, value: Any) -> tuple[str, ...]:
        if isinstance(value, str):
            return ("/bin/sh", "-c", value)
        if isinstance(value, list) and value and all(isinstance(word, str) for word in value):
            kind, words = value[0], tuple(value[1:])
            if kind == "NONE" and not words:
                return ()
            if kind == "CMD" and words:
                return words
            if kind == "CMD-SHELL" and len(words) == 1:
                return ("/bin/sh", "-c", words[0])
        raise _refuse(f"{value!r} is not a test", "write a line, [CMD, word, ...], [CMD-SHELL, line] or [NONE]")

    @model_validator(mode="after")
    def _has_test(self) -> "Healthcheck":
        if not self.disable and "test" not in self.model_fields_set:
            raise _refuse("no test", "add test: [CMD, word, ...], or disable: true")
        return self

    @property
    def is_on(self) -> bool:
        """Whether the check is run at all."""
        return bool(self.test) and not self.disable


class Service(_Part):
    """One service; a process group of its own when it runs."""

    command: Command
    environment: Environment = {}
    depends_on: Annotated[dict[str, Dependency], BeforeValidator(_parse_dependencies)] = {}
    healthcheck: Healthcheck | None = None
    restart: Annotated[RestartPolicy, BeforeValidator(_parse_restart)] = RestartPolicy(RestartWhen.NO)
    working_dir: str = Field(default=".", validation_alias=AliasChoices("x-working_dir", "working_dir"))
    stop_grace_period: Duration = 2.0
    profiles: tuple[str, ...] = ()
    notify: bool = Field(default=False, alias="x-notify")
    watchdog_s: float | None = Field(default=None, alias="x-watchdog_s", gt=0.0)
    up_where_installed: str | None = Field(
        default=None, alias="x-up_where_installed", pattern=r"^[A-Za-z_][A-Za-z0-9_]*$"
    )

    @property
    def comes_by_itself(self) -> bool:
        """Whether ``crosspih up`` starts it though nobody asked for its profile."""
        return self.up_where_installed is not None and find_spec(self.up_where_installed) is not None

    @model_validator(mode="before")
    @classmethod
    def _without_what_is_an_engines(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        if "x-working_dir" in value and "working_dir" in value:
            raise _refuse("has both x-working_dir and working_dir", "keep the one for whoever is to run it")
        return {key: entry for key, entry in value.items() if key not in ENGINE_KEYS}

    @model_validator(mode="after")
    def _watched_where_it_notifies(self) -> "Service":
        if self.watchdog_s is not None and not self.notify:
            raise _refuse("x-watchdog_s without x-notify", "add x-notify: true")
        return self

    @property
    def check(self) -> Healthcheck | None:
        """The check to run here: none where the service itself says how it is."""
        return None if self.notify or self.healthcheck is None or not self.healthcheck.is_on else self.healthcheck

    @property
    def has_health(self) -> bool:
        """Whether it can ever be healthy, and so be waited for with ``service_healthy``."""
        return self.notify or self.check is not None


class ComposeFile(_Part):
    """A whole compose file; top-level keys that begin with ``x-`` are there for YAML anchors and are dropped, as are
    those for a container engine."""

    name: str | None = Field(default=None, pattern=_NAME)
    services: dict[Annotated[str, Field(pattern=_NAME)], Service] = Field(min_length=1)

    @model_validator(mode="before")
    @classmethod
    def _without_extensions(cls, value: Any) -> Any:
        if isinstance(value, dict):
            return {
                key: entry
                for key, entry in value.items()
                if not str(key).startswith("x-") and key not in ENGINE_SECTIONS
            }
        return value
