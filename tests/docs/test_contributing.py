"""CONTRIBUTING.md and the page of the house: files, folders and names that they send somebody to are there."""

from __future__ import annotations

import re

import pytest

from crosspih_common.strategy import Tools
from tests.conftest import ROOT

PAGES = ("CONTRIBUTING.md", "docs/house.md")
# a name that a list tells one to add to, and the file that has it
NAMES = {
    "ALL": "crosspih_common/keys.py",
    "AWAITED": "tests/system/test_key_table.py",
    "DRIVERS": "services/hardware/drivers/registry.py",
    "NAMED": "crosspih_common/shapes/named.py",
    "REFUSALS": "crosspih_common/refusals.py",
    "STRATEGIES": "services/planning/strategies/__init__.py",
    "WITH_PROCESSES": "tests/conftest.py",
    "_SIZES_OF": "crosspih_common/config/drawing.py",
}
PATH = re.compile(r"`((?:crosspih_common|services|tests|docs|deploy)/[\w./-]*|pyproject\.toml)`")
TESTS = re.compile(r"`pytest ([^`]*)`")


@pytest.mark.parametrize("page", PAGES)
def test_paths_exist(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    paths = PATH.findall(text) + [word for words in TESTS.findall(text) for word in words.split()]
    assert paths
    assert [path for path in paths if "NAME" not in path and not (ROOT / path).exists()] == []


@pytest.mark.parametrize(("name", "file"), NAMES.items())
def test_names_are_where_they_are_said_to_be(name: str, file: str) -> None:
    assert re.search(rf"^{name}\b", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), f"{file} has no {name}"
    assert f"`{name}`" in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_what_a_strategy_is_given_is_told_by_its_names() -> None:
    page = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
    table = page[page.index("| `tools` |") : page.index("`crosspih_common/strategy.py` has")]
    told = set(re.findall(r"`(\w+)(?:\([^`]*\))?`", table)) - {"tools"}
    assert told == {name for name in vars(Tools) if not name.startswith("_")}


def test_the_newest_version_is_the_packages() -> None:
    """Each version has a date; the first one below what is unreleased is that of pyproject.toml."""
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    versions = re.findall(r"^## (\d+\.\d+\.\d+) - \d{4}-\d\d-\d\d$", changes, re.MULTILINE)
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert re.findall(r'^version = "(.*)"$', project, re.MULTILINE) == versions[:1]
    assert versions == sorted(versions, key=lambda version: [int(part) for part in version.split(".")], reverse=True)
