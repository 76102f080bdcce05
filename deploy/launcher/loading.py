"""Reading a compose file: YAML, then variables, then the strict model; every fault named with its field and mend."""

import difflib
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from crosspih_common.endpoints import ENDPOINT_VARIABLE, fault_of
from crosspih_common.plain_yaml import MAX_BYTES, text_of_file, yaml_of
from deploy.launcher.compose import ComposeFile, Dependency, Healthcheck, Service
from deploy.launcher.conditions import StartCondition
from deploy.launcher.errors import ComposeError, Fault
from deploy.launcher.interpolation import interpolate
from deploy.launcher.order import cycle_among

# What would change what a service is, knows or reaches, and that only in a container: it is refused, not left out.
_CONTAINER_KEYS = frozenset(
    {"configs", "deploy", "dns", "entrypoint", "expose", "extra_hosts", "links", "networks", "pid", "ports"}
    | {"privileged", "secrets", "tty"}
)

# Where addresses of routers stand: (variable, argument of a command, whether several may stand there).
_ADDRESSES = (
    (ENDPOINT_VARIABLE, "--endpoint", False),
    ("CROSSPIH_ROUTER_LISTEN", "--listen", True),
    ("CROSSPIH_ROUTERS", "--routers", True),
)


def load_compose(path: Path, variables: Mapping[str, str]) -> ComposeFile:
    """Read and check the compose file at ``path`` with ``variables`` (usually ``os.environ``).

    Raises ComposeError with every fault found: unreadable, not YAML, an unset variable, an unknown key, a wrong value,
    a dependency that does not exist or goes round in a circle.
    """
    try:
        text = text_of_file(path, MAX_BYTES)
    except OSError as error:
        raise ComposeError(
            str(path), [Fault("file", error.strerror or str(error), "name a compose file with --file")]
        ) from error
    return parse_compose(text, variables, str(path))


def parse_compose(text: str, variables: Mapping[str, str], source: str = "compose.yaml") -> ComposeFile:
    """As :func:`load_compose`, from the file's text; ``source`` is the name used in errors."""
    try:
        tree = yaml_of(text)
    except yaml.YAMLError as error:
        problem = " ".join(str(error).split())
        raise ComposeError(source, [Fault("file", f"not YAML: {problem}", "mend the line named")]) from error
    if not isinstance(tree, dict):
        raise ComposeError(source, [Fault("file", "no mapping at the top", "begin with 'services:'")])
    # What is in an extension key counts only where an anchor brings it into a service.
    tree = {key: value for key, value in tree.items() if not str(key).startswith("x-")}
    tree, faults = interpolate(tree, variables)
    if faults:
        raise ComposeError(source, faults)
    try:
        compose = ComposeFile.model_validate(tree)
    except ValidationError as error:
        raise ComposeError(source, [_fault(entry) for entry in error.errors(include_url=False)]) from error
    faults = _dependency_faults(compose) + _address_faults(compose, variables)
    if faults:
        raise ComposeError(source, faults)
    return compose


def _fault(entry: Any) -> Fault:
    location = tuple(str(part) for part in entry["loc"])
    field = ".".join(location) or "file"
    mend = entry.get("ctx", {}).get("mend")
    if entry["type"] == "extra_forbidden":
        return Fault(field, "unknown key", _mend_unknown_key(location))
    if entry["type"] == "missing":
        return Fault(field, "missing", f"add {location[-1]}:")
    if entry["type"] == "enum":
        return Fault(field, f"{entry['input']!r} is not known", f"write {entry['ctx']['expected']}")
    return Fault(field, entry["msg"], mend or f"mend the value {entry['input']!r}")


def _mend_unknown_key(location: tuple[str, ...]) -> str:
    key, model = location[-1], _model_at(location[:-1])
    known = sorted(info.alias or name for name, info in model.model_fields.items())
    if model is not Healthcheck and key in _CONTAINER_KEYS:
        return "services are local processes here and have no containers: remove it"
    near = difflib.get_close_matches(key, known, n=1)
    return f"did you mean {near[0]}?" if near else f"known keys are {', '.join(known)}"


def _model_at(location: tuple[str, ...]) -> type[BaseModel]:
    if "healthcheck" in location[2:]:
        return Healthcheck
    if "depends_on" in location[2:]:
        return Dependency
    return Service if location[:1] == ("services",) else ComposeFile


def _dependency_faults(compose: ComposeFile) -> list[Fault]:
    faults: list[Fault] = []
    for name, service in compose.services.items():
        for needed, dependency in service.depends_on.items():
            field = f"services.{name}.depends_on.{needed}"
            if needed not in compose.services:
                near = difflib.get_close_matches(needed, compose.services, n=1)
                known = ", ".join(sorted(compose.services))
                faults.append(
                    Fault(field, "no such service", f"did you mean {near[0]}?" if near else f"services are {known}")
                )
            elif dependency.condition is StartCondition.HEALTHY and not compose.services[needed].has_health:
                faults.append(
                    Fault(
                        field,
                        f"waits for {needed} to be healthy, which has no way to be",
                        f"give {needed} a healthcheck or x-notify: true, or wait for service_started",
                    )
                )
    if not faults and (cycle := cycle_among(compose.services)):
        faults.append(
            Fault(f"services.{cycle[0]}.depends_on", f"goes round: {' -> '.join(cycle)}", "remove one of these")
        )
    return faults


def _address_faults(compose: ComposeFile, variables: Mapping[str, str]) -> list[Fault]:
    """What is no address is refused here, or a router that cannot listen there would be started again and again.

    Each is told once: what comes from a variable goes to every service.
    """
    faults: dict[tuple[str, str], Fault] = {}
    for name, service in compose.services.items():
        for variable, argument, several in _ADDRESSES:
            given = [(variable, service.environment.get(variable) or variables.get(variable) or "")]
            for word, following in zip_longest(service.command, service.command[1:], fillvalue=""):
                option, _, value = word.partition("=")
                if option == argument:
                    given.append((f"services.{name}.command {argument}", value or following))
            for field, text in given:
                for one in text.split(",") if several else [text]:
                    problem, mend = fault_of(one.strip()) if one.strip() else ("", "")
                    if problem:
                        faults[field, one] = Fault(field, problem, mend)
    return list(faults.values())
