"""The docs as a site: built without a warning and with nothing that would be fetched while it is read."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import ROOT

pytest.importorskip("mkdocs", reason="the extra docs is not installed")
BUILD_S = 120.0  # a deadline, on a machine with much else to do
FETCHED = re.compile(r"""(?:src|href)=["'](?:https?:)?//[^"']+\.(?:js|css|woff2?|png|svg|jpg)\b""")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """`make docs` into a folder of its own; a warning ends it."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=BUILD_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    yield folder


def test_every_page_is_there(site: Path) -> None:
    for page in (ROOT / "docs").rglob("*.md"):
        name = page.relative_to(ROOT / "docs").with_suffix(".html")
        assert (site / (name.with_name("index.html") if name.stem == "README" else name)).exists(), name
    for made in ("index", "contributing", "changelog", "source/services/hardware/protocols.py"):
        assert (site / f"{made}.html").exists(), made


def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not FETCHED.findall(text), page.name
        assert 'class="mermaid"' not in text, f"{page.name}: Material would fetch mermaid"


def test_equations_are_mathml_and_figures_follow_the_theme(site: Path) -> None:
    text = (site / "how-it-works.html").read_text(encoding="utf-8")
    assert text.count("<math") > 15 and "arithmatex" not in text
    shown = re.findall(r'src="(figures/[\w-]+\.svg)#only-(light|dark)"', text)
    assert all((site / name).exists() for name, _ in shown)
    assert sorted(name for name, theme in shown if theme == "dark") == sorted(
        name.replace(".svg", "-dark.svg") for name, theme in shown if theme == "light"
    )
    assert len(shown) >= 10


def test_the_drivers_api_has_every_protocol(site: Path) -> None:
    text = (site / "api/drivers.html").read_text(encoding="utf-8")
    for name in ("JointDevice", "WrenchDevice", "CameraDevice", "Devices", "OpenRequest"):
        assert name in text
