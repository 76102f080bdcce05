"""Every command that README and docs show exists as shown, and is run by a test or marked as long.

- Each `crosspih ...` is parsed by the real command line: a command, an option or a value that it does not have fails.
- Each is run by the test that `RUN_BY` names, is run here (`RUN_HERE`), or has a comment that begins with "long": it
  takes more than a minute, or needs hands or devices.
- Modules, make targets, extras and test files that are shown exist. Other programs are those of `OTHERS`.
"""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import pytest
from typer.core import TyperGroup
from typer.testing import CliRunner

from tests.docs.commands import ROOT, Shown, command_line, parsed, shown_commands

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pytest brings it

RUN_BY = {
    "assemble": "tests/system/test_commands.py",
    "bench assembly": "tests/system/test_commands.py",
    "calibrate board": "tests/calibration/test_cameras.py",
    "calibrate ft": "tests/system/test_commands.py",
    "calibrate refine": "tests/operator/calibrate/test_refine.py",
    "cell check": "tests/system/test_cell_check.py",
    "cell init": "tests/operator/cell/test_cell_init.py",
    "dataset collect": "tests/operator/dataset/test_dataset.py",
    "dataset show": "tests/operator/dataset/test_dataset.py",
    "dataset synthesise": "tests/operator/dataset/test_dataset.py",
    "doctor": "tests/operator/doctor/test_doctor.py",
    "down": "tests/deploy/test_stack.py",
    "keys": "tests/system/test_commands.py",
    "locate": "tests/operator/locate/test_locate.py",
    "logs": "tests/deploy/test_stack.py",
    "peg check": "tests/operator/peg/test_peg_check.py",
    "ps": "tests/deploy/test_stack.py",
    "recording animate": "tests/recorder/test_animate.py",
    "recording check": "tests/operator/recordings/test_recording_commands.py",
    "recording cut": "tests/operator/recordings/test_recording_commands.py",
    "recording export csv": "tests/operator/recordings/test_recording_commands.py",
    "recording export layouts": "tests/foxglove/test_layouts.py",
    "recording export ros2": "tests/ros2/test_export.py",
    "recording info": "tests/operator/recordings/test_recording_commands.py",
    "recording merge": "tests/operator/recordings/test_recording_commands.py",
    "recording recover": "tests/operator/recordings/test_recording_commands.py",
    "replay": "tests/operator/recordings/test_replay.py",
    "report": "tests/system/test_commands.py",
    "security init": "tests/security/test_certificates.py",
    "train": "tests/operator/dataset/test_dataset.py",
    "up": "tests/deploy/test_stack.py",
    "withdraw": "tests/system/test_without_simulator.py",
}
RUN_HERE = {
    "cell drivers": ("cell", "drivers"),
}
# of the system, of Python or of ROS
OTHERS = {
    ".", "cd", "chmod", "colcon", "cp", "docker", "git", "ip", "pip", "pre-commit", "ros2", "setpriv", "sudo",
    "VENV/bin/pip",
}  # fmt: skip
MADE_LIST = "docs/cli.md"  # an example of every command there is, made from their own table
LONG = re.compile(r"\s*long\b")
SHOWN = list(shown_commands())
OURS = [one for one in SHOWN if one.words[0] == "crosspih"]


def test_the_commands_are_found() -> None:
    assert len(OURS) > 100
    assert {one.page for one in OURS} >= {"README.md", "docs/start.md", "docs/benches.md", "docs/hardware/in-a-day.md"}


@pytest.fixture(scope="module")
def root() -> TyperGroup:
    return command_line()


@pytest.fixture(scope="module")
def names(root: TyperGroup) -> dict[Shown, str | Exception]:
    """What each command calls, "bench assembly", or why the command line does not take it."""
    found: dict[Shown, str | Exception] = {}
    for one in OURS:
        try:
            found[one] = " ".join(parsed(root, one.words[1:]))
        except Exception as error:
            found[one] = error
    return found


def test_each_command_is_parsed_by_the_command_line_itself(names: dict[Shown, str | Exception]) -> None:
    wrong = [f"{one}: {getattr(what, 'message', what)!r}" for one, what in names.items() if isinstance(what, Exception)]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "words",
    [("bench", "asembly"), ("assemble", "--sed", "7"), ("assemble", "--seed", "seven"), ("report",), ("ps", "extra")],
)
def test_a_misspelt_command_is_found(root: TyperGroup, words: tuple[str, ...]) -> None:
    with pytest.raises(Exception, match=r"(?i)no such|not a valid|missing|unexpected|asembly|unable to parse"):
        parsed(root, words)


def test_each_command_is_run_by_a_test_or_marked_as_long(names: dict[Shown, str | Exception]) -> None:
    run = {"", *RUN_BY, *RUN_HERE}
    neither = [
        str(one)
        for one, name in names.items()
        if LONG.match(one.comment) is None and name not in run and one.page != MADE_LIST
    ]
    assert not neither, "\n".join(neither)


@pytest.mark.parametrize(("name", "test"), RUN_BY.items())
def test_the_test_that_is_named_runs_it(name: str, test: str) -> None:
    said = re.findall(r"[a-z][\w-]*", (ROOT / test).read_text(encoding="utf-8"))
    assert name.split()[-1] in said, f"{test} does not name {name}"


@pytest.mark.parametrize("words", RUN_HERE.values(), ids=RUN_HERE)
def test_a_cheap_command_runs(words: tuple[str, ...]) -> None:
    from services.operator.__main__ import app

    done = CliRunner().invoke(app, [*words], env={"COLUMNS": "120"})
    assert done.exit_code == 0, done.output


def test_modules_targets_extras_and_tests_exist() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    wrong = []
    for one in SHOWN:
        program, *rest = one.words
        if program == "make":
            wrong += [f"{one}: no target {word}" for word in rest[:1] if word not in targets]
        elif program in ("python", ".venv/bin/python"):
            wrong += _of_python(one, rest)
        elif program == "pytest":
            wrong += [f"{one}: no {word}" for word in rest if word.startswith("tests/") and not _test(word).exists()]
        elif program != "crosspih" and program not in OTHERS:
            wrong.append(f"{one}: what is {program}?")
        for names in re.findall(r"crosspih\[([\w,-]+)\]", " ".join(rest)):
            wrong += [f"{one}: no extra {name}" for name in names.split(",") if name not in extras]
    assert not wrong, "\n".join(wrong)


def _of_python(one: Shown, rest: list[str]) -> list[str]:
    """What is wrong with `python -m module --options` or `python file.py`: options stand somewhere in its folder."""
    if rest[:1] != ["-m"]:
        return [f"{one}: no {word}" for word in rest[:1] if not (ROOT / word).exists()]
    module = rest[1]
    if module == "pytest":
        return [f"{one}: no {word}" for word in rest if word.startswith("tests/") and not _test(word).exists()]
    found = importlib.util.find_spec(module)
    if found is None or found.origin is None:
        return [f"{one}: no module {module}"]
    near = Path(found.origin)
    sources = sorted(near.parent.rglob("*.py")) if near.name == "__init__.py" else sorted(near.parent.glob("*.py"))
    sources += [ROOT / "crosspih_common/service/lifecycle.py"]
    text = "".join(path.read_text(encoding="utf-8") for path in sources)
    options = [word.partition("=")[0] for word in rest[2:] if word.startswith("--")]
    return [f"{one}: no option {option}" for option in options if f'"{option}"' not in text]


def _test(word: str) -> Path:
    return ROOT / word.partition("::")[0]
