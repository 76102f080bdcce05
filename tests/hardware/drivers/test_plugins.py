"""Drivers of other packages: distributions as pip installs them, met by a process that finds them on its path."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
SOUND = """
from docs.examples.spring_wall import open_devices as the_wall

def open_devices(request):
    return the_wall(request)

open_devices.opens = ("arm", "force_torque")
"""


def installed(folder: Path, package: str, source: str, **entries: str) -> None:
    """A pure distribution in a folder of packages: its module, its dist-info, its entry points."""
    folder.mkdir(exist_ok=True)
    module = package.replace("-", "_")
    (folder / f"{module}.py").write_text(source)
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    lines = "".join(f"{name} = {target}\n" for name, target in entries.items())
    (info / "entry_points.txt").write_text(f"[crosspih.drivers]\n{lines}")


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(ROOT), str(folder)])
    return subprocess.run(
        [sys.executable, "-m", *arguments],
        env={**os.environ, "PYTHONPATH": path}, cwd=folder, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


def check(folder: Path, driver: str) -> tuple[list[dict[str, str]], str]:
    cell = folder / "cell.yaml"
    cell.write_text(f"hardware: {{driver: '{driver}', devices: [arm, force_torque]}}")
    done = run(folder, "services.hardware", "--check", "--cell", str(cell))
    rows: list[dict[str, str]] = json.loads(done.stdout)
    return rows, done.stderr


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packages")
    installed(folder, "wall-lab", SOUND, wall="wall_lab:open_devices", simulated="wall_lab:open_devices")
    installed(folder, "broken-lab", "import a_library_that_is_not_there", broken="broken_lab:open_devices")
    installed(folder, "first-lab", SOUND, twice="first_lab:open_devices")
    installed(folder, "second-lab", SOUND, twice="second_lab:open_devices")
    installed(folder, "number-lab", "seven = 7", number="number_lab:seven")
    return folder


def test_an_installed_driver_opens_by_its_name(packages: Path) -> None:
    rows, _ = check(packages, "wall")
    named = {row["name"]: row for row in rows}
    assert {row["verdict"] for row in rows if row["name"].startswith("device")} == {"ok"}
    assert named["device arm"]["found"].startswith("wall: 6 joints inside their limits, a cycle of 2.00 ms")
    assert named["force limits"]["verdict"] == "warning"  # the wall declares no landing
    assert "hardware.limits.moved_mass_kg" in named["force limits"]["mend"]


ASK_ALL = """
import json, sys
from services.hardware.drivers import listing, registry as r
r.DRIVERS["ghost"] = r.BuiltIn("broken_lab:open_devices", "arm", "ghost",
                               (("ghost-sdk", "a_library_that_is_not_there"),), "ghost.host")
said = {}
for name in sys.argv[1:]:
    try:
        said[name] = r.opener(name).__module__
    except r.ConfigError as error:
        said[name] = str(error)
said["ghost listed"] = next(one.missing for one in listing.drivers() if one.name == "ghost")
print(json.dumps(said))
"""


def test_what_is_wrong_with_a_driver_is_named_with_its_mend_and_ours_go_first(packages: Path) -> None:
    """In a process of its own, whose table has a line more: a driver whose package nobody has."""
    path = os.pathsep.join([str(ROOT), str(packages)])
    names = ["broken", "twice", "number", "nobody", "simulated", "wall", "ghost"]
    done = subprocess.run(
        [sys.executable, "-c", ASK_ALL, *names],
        env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    said = json.loads(done.stdout)
    for name, words in {
        "broken": "broken of broken-lab (broken_lab:open_devices) cannot be loaded (ModuleNotFoundError: No module",
        "twice": "twice is a driver of first-lab and of second-lab; write which is meant: 'first_lab:open_devices' or",
        "number": "number of number-lab (number_lab:seven) is int, want a function that takes an OpenRequest",
        "nobody": "no driver 'nobody'; want ",
        "simulated": "services.hardware.drivers.simulated.cell",
        "wall": "wall_lab",
        "ghost": "hardware.driver: ghost needs ghost-sdk: pip install 'crosspih[ghost]'",
        "ghost listed": "ghost-sdk: pip install 'crosspih[ghost]'",
    }.items():
        assert words in said[name], name
    assert 'that of wall-lab has the same name and is not used: to have it write "wall_lab:open_devices"' in done.stderr


def test_all_drivers_are_listed_with_what_they_open_and_need(packages: Path) -> None:
    done = run(packages, "services.operator", "cell", "drivers", "--json")
    listed: list[dict[str, Any]] = json.loads(done.stdout)
    found = {(one["package"], one["name"]): one for one in listed}
    assert found["crosspih", "simulated"]["usable"] and found["crosspih", "pictures"]["opens"] == ["camera"]
    assert found["wall-lab", "wall"]["usable"] and found["wall-lab", "wall"]["opens"] == ["arm", "force_torque"]
    assert "a_library_that_is_not_there" in found["broken-lab", "broken"]["missing"]
    assert "another package has a driver of that name" in found["second-lab", "twice"]["missing"]
    assert "is not used" in found["wall-lab", "simulated"]["missing"]
