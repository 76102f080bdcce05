"""Where this installation lies, and how its modules are started from any folder."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DATA_VARIABLE = "CROSSPIH_DATA"
RUN_DIR_VARIABLE = "CROSSPIH_RUN_DIR"
ALL_PACKAGES = (
    "make env installs all that crosspih uses (with TORCH=any the larger torch, where no index has its CPU build)"
)
_RUNNER = str(Path(__file__).resolve().with_name("run_module.py"))


def module_command(module: str, *words: str) -> list[str]:
    """The command that runs a module of this installation, whatever the folder and PYTHONPATH hold (run_module.py)."""
    return [sys.executable, _RUNNER, module, *words]


def is_ours(module: str) -> bool:
    """Whether a module is one of this installation's."""
    return module.split(".")[0] in ("crosspih_common", "services", "deploy")


def on_demand(package: str, modules: Mapping[str, str]) -> Callable[[str], object]:
    """A package's `__getattr__` (PEP 562) that imports the module of each name when it is first asked for."""

    def find(name: str) -> object:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = getattr(import_module(f"{package}.{modules[name]}"), name)
        setattr(sys.modules[package], name, found)
        return found

    return find


def data_folder() -> Path:
    """The folder for recordings and calibrations with a relative path: $CROSSPIH_DATA, or the folder that the stack is
    started from. Absolute."""
    return Path(os.path.abspath(os.environ.get(DATA_VARIABLE) or "."))


def run_folder() -> Path:
    """Where running stacks keep their state and logs: ``$CROSSPIH_RUN_DIR``, or ``$CROSSPIH_DATA/run``, or ``run``
    beside the packages if that is a work tree that may be written, or ``run`` here."""
    if from_environment := os.environ.get(RUN_DIR_VARIABLE):
        return Path(from_environment)
    if os.environ.get(DATA_VARIABLE):
        return data_folder() / "run"
    ours = (ROOT / "pyproject.toml").exists() and os.access(ROOT, os.W_OK)
    return (ROOT if ours else Path.cwd()) / "run"


def not_installed(error: ModuleNotFoundError) -> str:
    """One line for a missing package that says how to install it. Raises the error again if the module is ours."""
    package = (error.name or "").split(".")[0]
    if not package or is_ours(package):
        raise error
    return f"{package} is not installed: {ALL_PACKAGES}"


def packaged(path: str) -> str:
    """A file that comes with this installation, by its path below the root; absolute."""
    return str(ROOT / path)


DEFAULT_CELL = packaged("deploy/cells/default.yaml")
