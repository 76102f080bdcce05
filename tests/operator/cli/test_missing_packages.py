"""What a command says that needs a package which set-up left out: one line that names it, with the mend."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from crosspih_common.arm import ur5e, xb4
from crosspih_common.arm.inverse import solver
from crosspih_common.config.arm import ArmSection
from crosspih_common.errors import ConfigError
from crosspih_common.modules import ALL_PACKAGES, not_installed


def _without(package: str, module: str, *words: str) -> subprocess.CompletedProcess[str]:
    """`python -m module words`, as where the package is not installed."""
    code = (
        f"import sys, runpy; sys.modules[{package!r}] = None; sys.argv = ['crosspih', *{words}]; "
        f"runpy.run_module({module!r}, run_name='__main__')"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_a_command_names_the_package_that_it_lacks() -> None:
    said = _without("pyarrow", "services.operator", "dataset", "show", "somewhere")
    assert said.returncode == 1 and said.stdout == ""
    assert said.stderr == f"crosspih: pyarrow is not installed: {ALL_PACKAGES}\n"


def test_a_training_without_torch_ends_with_the_mend() -> None:
    said = _without("torch", "services.inference.network", "train", "--paper-rows")
    assert said.returncode == 1 and said.stderr == ""
    assert json.loads(said.stdout) == {"error": f"torch is not installed: {ALL_PACKAGES}"}


def test_a_module_of_ours_that_is_not_there_is_a_defect_and_no_missing_package() -> None:
    with pytest.raises(ModuleNotFoundError):
        not_installed(ModuleNotFoundError("gone", name="services.nobody"))


def test_an_arm_that_needs_pinocchio_says_so_and_the_xb4_does_not(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for module in ("numerical", "urdf"):
        monkeypatch.setitem(sys.modules, f"crosspih_common.arm.{module}", None)
    made = solver.__wrapped__  # whatever a test before this one has left in the cache
    assert made(xb4()).singular([0.1, 0.5, 0.6, 0.1, 0.7, 0.1]) == ""
    mend = r"needs the package pin: make env installs it, or pip install 'crosspih\[arms\]'"
    with pytest.raises(ConfigError, match=rf"cell\.arm: ur5e: .*{mend}"):
        made(ur5e())
    with pytest.raises(ValueError, match=mend):
        ArmSection(urdf=str(tmp_path / "arm.urdf"))
