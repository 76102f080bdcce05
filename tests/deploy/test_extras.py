"""What set-up asks a package index for, by pyproject.toml: an assembly's part stays as small as it is said to be."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.deploy.harness import ROOT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pytest brings it

PROJECT = tomllib.loads(Path(ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]
OF_ANY_INTERPRETER = {
    "coal", "eclipse-zenoh", "foxglove-schemas-protobuf", "jinja2", "matplotlib", "mcap", "numpy",
    "opencv-python-headless", "packaging", "pydantic", "pyyaml", "rich", "scipy", "shapely", "typer",
}  # fmt: skip


def _asked(extra: str, environment: dict[str, str]) -> set[str]:
    """The packages of an extra with the extras it takes in, and of every service, on that machine."""
    found: set[str] = set()
    for requirement in (Requirement(one) for one in [*PROJECT["dependencies"], *EXTRAS[extra]]):
        if requirement.marker is not None and not requirement.marker.evaluate(environment):
            continue
        if requirement.name == PROJECT["name"]:
            for other in requirement.extras:
                found |= _asked(other, environment)
        else:
            found.add(requirement.name)
    return found


@pytest.mark.parametrize(
    ("version", "machine", "engine"),
    [("3.10", "x86_64", "pybullet"), ("3.11", "x86_64", "pybullet"), ("3.12", "x86_64", "mujoco"),
     ("3.13", "x86_64", "mujoco"), ("3.11", "aarch64", "mujoco")],
)  # fmt: skip
def test_an_assembly_is_set_up_with_these_packages_and_no_other(version: str, machine: str, engine: str) -> None:
    """One more costs whoever types `make assemble` time and room (docs/performance.md says what each weighs)."""
    here = {"python_version": version, "sys_platform": "linux", "platform_machine": machine}
    assert _asked("run", here) == {*OF_ANY_INTERPRETER, engine}


def test_what_an_assembly_leaves_out_comes_with_the_whole() -> None:
    here = {"python_version": "3.11", "sys_platform": "linux", "platform_machine": "x86_64"}
    more = _asked("all", here) - _asked("run", here)
    assert more == {"cryptography", "ezdxf", "mujoco", "pandas", "pin", "pyarrow", "safetensors", "torch", "viser"}


def test_every_package_is_pinned() -> None:
    lines = (ROOT / "deploy" / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {_plain(line.split("==")[0]) for line in lines if line and not line.startswith("#")}
    here = {"python_version": "3.11", "sys_platform": "linux", "platform_machine": "x86_64"}
    assert not {name for extra in EXTRAS for name in _asked(extra, here) if _plain(name) not in pinned}


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
