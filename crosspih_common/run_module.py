"""Runs a module of this installation: ``run_module.py <module> <word>...``, as ``python -m <module> <word>...`` would.

With ``-m`` Python looks in the caller's folder first, and in PYTHONPATH: a folder there that holds a package called
``services`` or ``deploy`` would be run instead of ours. Here the packages beside this file are found first, by their
own place, and the caller's folder is not searched at all. A script, started by modules.py; standard library only.
"""

import importlib.util
import os
import runpy
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
PACKAGES = ("crosspih_common", "services", "deploy")


def _load(name: str) -> None:
    folder = os.path.join(ROOT, name)
    spec = importlib.util.spec_from_file_location(
        name, os.path.join(folder, "__init__.py"), submodule_search_locations=[folder]
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)


def main() -> None:
    """Load the packages of this installation, then run the module named."""
    module = sys.argv[1]
    here = os.path.dirname(os.path.abspath(__file__))
    # the script's own folder, where modules of ours have names of the standard library's
    sys.path[:] = [entry for entry in sys.path if os.path.abspath(entry or ".") != here]
    if ROOT not in sys.path:
        sys.path.append(ROOT)
    for name in PACKAGES:
        if os.path.isfile(os.path.join(ROOT, name, "__init__.py")):
            _load(name)
    sys.argv = sys.argv[1:]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
