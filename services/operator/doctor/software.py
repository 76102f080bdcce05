"""Python, packages, and whether their compiled parts load."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import PackageNotFoundError, requires, version

from packaging.requirements import InvalidRequirement, Requirement

from services.operator.cli.rows import Row, ok, warning, wrong
from services.operator.other_services.beside import run_module

OLDEST, NEWEST_TRIED = (3, 10), (3, 13)
SERVICES = ("router", "hardware", "vision", "force_torque", "inference", "planning", "recorder", "operator")
# compiled packages: each is imported in a separate process, because a broken one may crash it
COMPILED = ("zenoh", "numpy", "scipy.spatial", "pydantic_core", "shapely", "cv2", "pinocchio", "coal", "zstandard")


def python_row(found: tuple[int, ...] = tuple(sys.version_info[:3])) -> Row:
    """The interpreter."""
    text = ".".join(str(part) for part in found)
    if found[:2] < OLDEST:
        return wrong("python", f"{text} is too old", "make env PYTHON=python3.12; crosspih needs 3.10 or newer")
    if found[:2] > NEWEST_TRIED:
        return warning("python", f"{text} is newer than what crosspih is tested with", "use Python 3.10 to 3.13")
    return ok("python", text)


def package_rows(distribution: str = "crosspih", services: Sequence[str] = SERVICES) -> Iterator[Row]:
    """Every package that the services on this machine need, at a version that they can use."""
    try:
        wanted = requires(distribution) or []
    except PackageNotFoundError:
        yield warning("packages", f"{distribution} is not installed here, so what it needs is not known", "make env")
        return
    count = 0
    for line in wanted:
        try:
            need = Requirement(line)
        except InvalidRequirement:
            continue
        of = [extra for extra in ("", *services) if need.marker is None or need.marker.evaluate({"extra": extra})]
        if not of or need.name == distribution:
            continue
        count += 1
        mend = f"pip install '{need.name}{need.specifier}', or make env"
        needs = f"{need.name}{need.specifier} is needed by {', '.join(filter(None, of)) or 'all services'}"
        try:
            have = version(need.name)
        except PackageNotFoundError:
            yield wrong(f"package {need.name}", f"is not installed; {needs}", mend)
            continue
        if not need.specifier.contains(have, prereleases=True):
            yield wrong(f"package {need.name}", f"{have} is here; {needs}", mend)
    yield ok("packages", f"{count} looked at; zenoh {_version('eclipse-zenoh')}, numpy {_version('numpy')}")


def wheel_rows(modules: Sequence[str] = COMPILED) -> Iterator[Row]:
    """Whether each compiled package can be imported together with the others."""
    said = run_module("services.operator.doctor.loading", *modules)
    failed = said.value if isinstance(said.value, dict) else None
    if failed is None:
        mend = "pip install --force-reinstall the package that was loading, or make env"
        yield wrong("wheels", f"a package ended the process that loaded it: {said.words}", mend)
        return
    for module, why in failed.items():
        yield wrong(f"wheel {module}", f"does not load: {why}", "pip install --force-reinstall it, or make env")
    if not failed:
        yield ok("wheels", f"{', '.join(modules)} load")


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"
