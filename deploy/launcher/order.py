"""Which services run, and in what order: they start after what they depend on and stop before it."""

import difflib
from collections.abc import Collection, Iterable, Mapping
from graphlib import CycleError, TopologicalSorter

from deploy.launcher.compose import Service
from deploy.launcher.errors import ComposeError, Fault


def cycle_among(services: Mapping[str, Service]) -> list[str]:
    """One circle of dependencies, its first service repeated at the end; empty if there is none."""
    try:
        TopologicalSorter({name: service.depends_on.keys() for name, service in services.items()}).prepare()
    except CycleError as error:
        # graphlib lists each node before the one that depends on it; the other way round reads as "depends on".
        return list(reversed(error.args[1]))
    return []


def select(services: Mapping[str, Service], named: Collection[str], profiles: Collection[str]) -> dict[str, Service]:
    """The services to run, in file order: those ``named`` (or all whose profile is on), and what they need.

    A service without ``profiles`` is always on; one with is on if one of them is in ``profiles`` or it is named.
    Raises ComposeError if a name is unknown, or if a required dependency is kept out by its profile.
    """
    unknown = [name for name in named if name not in services]
    if unknown:
        raise ComposeError(
            "services",
            [Fault(name, "no such service", _suggest(name, services)) for name in unknown],
        )
    wanted = list(named) or [
        name for name, service in services.items() if not service.profiles or set(service.profiles) & set(profiles)
    ]
    chosen: set[str] = set()
    while wanted:
        name = wanted.pop()
        if name in chosen:
            continue
        chosen.add(name)
        for needed, dependency in services[name].depends_on.items():
            off = services[needed].profiles and not set(services[needed].profiles) & {*profiles}
            if off and dependency.required and needed not in named:
                problem = f"needs {needed}, whose profile is off"
                raise ComposeError(
                    "services",
                    [Fault(name, problem, f"add --profile {services[needed].profiles[0]}, or name {needed} too")],
                )
            if dependency.required:
                wanted.append(needed)
    return {name: service for name, service in services.items() if name in chosen}


def start_levels(services: Mapping[str, Service]) -> list[list[str]]:
    """The services in levels: each depends on services of earlier levels only. Stopping goes the other way."""
    sorter = TopologicalSorter(
        {name: [needed for needed in service.depends_on if needed in services] for name, service in services.items()}
    )
    sorter.prepare()
    levels: list[list[str]] = []
    while sorter.is_active():
        level = list(sorter.get_ready())
        levels.append(sorted(level))
        sorter.done(*level)
    return levels


def _suggest(name: str, services: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, list(services), n=1)
    return f"did you mean {near[0]}?" if near else f"services are {', '.join(sorted(services))}"
