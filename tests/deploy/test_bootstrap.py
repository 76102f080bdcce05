"""Set-up where something is missing: one line that says what, on standard error, and nothing else."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.deploy.harness import ROOT

TOOLS = ("sh", "cat", "cksum", "date", "dirname", "grep", "ls", "rm", "sed", "tail", "uname")


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A work tree with just what set-up reads, and a folder ``bin`` with just the tools it uses."""
    root = tmp_path / "tree"
    (root / "deploy").mkdir(parents=True)
    for name in ("pyproject.toml", "deploy/constraints.txt", "deploy/bootstrap.sh"):
        shutil.copy(ROOT / name, root / name)
    (root / "bin").mkdir()
    for tool in TOOLS:
        found = shutil.which(tool)
        assert found is not None, tool
        (root / "bin" / tool).symlink_to(found)
    return root


def _interpreter(tree: Path, name: str, body: str) -> Path:
    path = tree / "bin" / name
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return path


def _refusal(tree: Path, **variables: str) -> str:
    done = subprocess.run(
        ["sh", "deploy/bootstrap.sh"],
        cwd=tree,
        env={"PATH": str(tree / "bin"), "HOME": str(tree), **variables},
        capture_output=True,
        text=True,
        check=False,
        timeout=120.0,
    )
    assert done.returncode == 1
    assert done.stdout == ""
    return done.stderr


def test_no_python(tree: Path) -> None:
    said = "crosspih: no Python found; install Python 3.10 or newer, or name it with PYTHON=/path/to/python3\n"
    assert _refusal(tree) == said


def test_named_python_is_absent(tree: Path) -> None:
    assert _refusal(tree, PYTHON="python9") == "crosspih: no Python at PYTHON=python9; name one that is 3.10 or newer\n"


def test_old_python(tree: Path) -> None:
    old = _interpreter(tree, "python3", 'case "$2" in *print*) echo 3.8.10;; *) exit 1;; esac')
    said = "crosspih: python3 is Python 3.8.10; install 3.10 or newer, or name one with PYTHON=/path/to/python3\n"
    assert _refusal(tree) == said
    assert _refusal(tree, PYTHON=str(old)) == f"crosspih: PYTHON={old} is Python 3.8.10; 3.10 or newer is needed\n"


def _pretend(tree: Path, name: str, version: tuple[int, int]) -> None:
    """A Python that says it is of this version, on Linux and x86_64, and whose venv module then fails to make one."""
    code = (
        "import sys, platform; sys.platform = 'linux'; platform.machine = lambda: 'x86_64'; "
        f"sys.version_info = ({version[0]}, {version[1]}, 0); exec(sys.argv.pop(1))"
    )
    _interpreter(tree, name, f'case "$1" in -c) shift; exec {sys.executable} -c "{code}" "$@";; *) exit 1;; esac')


@pytest.mark.parametrize(
    ("there", "taken"),
    [
        ({"python3": (3, 13), "python3.11": (3, 11), "python3.10": (3, 10)}, "3.11.0"),
        ({"python3": (3, 10), "python3.11": (3, 11)}, "3.10.0"),
        ({"python3": (3, 12), "python3.13": (3, 13)}, "3.12.0"),
        ({"python3": (3, 9), "python3.13": (3, 13)}, "3.13.0"),
    ],
)
def test_an_interpreter_that_has_all_wheels_is_preferred(
    tree: Path, there: dict[str, tuple[int, int]], taken: str
) -> None:
    for name, version in there.items():
        _pretend(tree, name, version)
    assert _refusal(tree).startswith(f"crosspih: making .venv with Python {taken};")


def test_torch_is_any_or_nothing(tree: Path) -> None:
    assert _refusal(tree, TORCH="all") == "crosspih: TORCH=all: want any, or nothing\n"


def test_parts_are_run_or_all(tree: Path) -> None:
    assert _refusal(tree, PARTS="some") == "crosspih: PARTS=some: want run or all\n"


def test_an_assembly_is_set_up_without_what_it_does_not_need(tree: Path) -> None:
    """What is asked of pip, by an interpreter that only writes it down; an environment that has all keeps it."""
    asked = tree / "asked"
    body = f"""case "$*" in
  *"-m venv"*) mkdir -p .venv/bin; echo >.venv/pyvenv.cfg; ln -sf {tree}/bin/python3 .venv/bin/python;;
  *"-m pip"*) echo "$*" >>{asked};;
  *) exec {sys.executable} "$@";;
esac"""
    _interpreter(tree, "python3", body)
    for tool in ("mkdir", "ln"):
        (tree / "bin" / tool).symlink_to(shutil.which(tool) or "")

    def set_up(parts: str) -> str:
        asked.write_text("")
        environment = {"PATH": str(tree / "bin"), "HOME": str(tree), "PARTS": parts}
        subprocess.run(
            ["sh", "deploy/bootstrap.sh"], cwd=tree, env=environment, capture_output=True, check=True, timeout=120.0
        )
        return asked.read_text()

    first = set_up("run")
    assert "--editable .[run]" in first and "torch" not in first
    assert set_up("run") == ""
    everything = set_up("all")
    assert "--editable .[all,dev]" in everything
    assert set_up("run") == set_up("all") == ""


def test_python_without_venv(tree: Path) -> None:
    _interpreter(tree, "python3", f'case "$2" in *venv*) exit 1;; *) exec {sys.executable} "$@";; esac')
    said = "crosspih: python3 has no venv module; install it (Debian and Ubuntu: apt install python3-venv)\n"
    assert _refusal(tree) == said


def test_folder_that_is_no_environment_is_not_touched(tree: Path) -> None:
    precious = tree / "data" / "precious"
    precious.parent.mkdir()
    precious.touch()
    said = "crosspih: VENV=data exists and is no virtual environment; name another folder\n"
    assert _refusal(tree, PYTHON=sys.executable, VENV="data") == said
    assert precious.exists()


def test_no_network(tree: Path) -> None:
    nowhere = {"PIP_CONFIG_FILE": os.devnull, "PIP_INDEX_URL": "http://127.0.0.1:9/simple"}
    first, second = _refusal(tree, PYTHON=sys.executable, **nowhere).splitlines()
    assert first.startswith("crosspih: making .venv with Python ")
    assert second.startswith("crosspih: no network: pip reached no package index; connect, or ")
    assert not (tree / ".venv" / ".crosspih-stamp").exists()
