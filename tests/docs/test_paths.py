"""Every page of the docs: the files, folders and modules of this repository that it names are there, and so are the
targets of its links."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.commands import MADE, PAGES, ROOT

PLACE = r"(?:crosspih_common|services|tests|docs|deploy|\.ci)"
CODE = re.compile(r"`([^`\n]+)`")
BLOCK = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
# a file or folder from the top: it has a slash, and an extension or a slash at its end
PATH = re.compile(rf"(?<![\w./-]){PLACE}/[\w./-]*?(?:\.[a-z0-9]+|/)(?![\w./*{{-])")
MODULE = re.compile(rf"(?<![\w./]){PLACE}(?:\.[a-z_][a-z0-9_]*)+(?![\w/])")
LINK = re.compile(r"\]\((?!https?:|mailto:|#)([^)#\s]+)(?:#[^)\s]*)?\)")
STANDS_FOR = re.compile(r"/(?:NAME|ARM)\b|^docs/results/")
KNOWN = [page for page in [*PAGES, ROOT / "CHANGELOG.md"] if page.name not in MADE]


def _files(text: str) -> list[str]:
    """Paths in code, but for those that stand for many, or that a command makes."""
    spans = [*CODE.findall(BLOCK.sub("", text)), *BLOCK.findall(text)]
    return [path for span in spans for path in PATH.findall(span) if not STANDS_FOR.search(path)]


def _modules(text: str) -> list[str]:
    return [name for span in CODE.findall(BLOCK.sub("", text)) for name in MODULE.findall(span) if "/" not in span]


def _is_module(name: str) -> bool:
    """Whether it is a module, or what a module has: `crosspih_common.keys.topics`."""
    path = ROOT.joinpath(*name.split("."))
    return (
        path.is_dir()
        or path.with_suffix(".py").exists()
        or (path.parent.with_suffix(".py").exists() and path.name in path.parent.with_suffix(".py").read_text("utf-8"))
        or ((path.parent / "__init__.py").exists() and path.name in (path.parent / "__init__.py").read_text("utf-8"))
    )


@pytest.mark.parametrize("page", KNOWN, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_what_a_page_names_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    wrong = [path for path in _files(text) if not (ROOT / path).exists()]
    wrong += [name for name in _modules(text) if not _is_module(name)]
    wrong += [link for link in LINK.findall(BLOCK.sub("", text)) if not (page.parent / link).exists()]
    assert wrong == []


def test_a_file_that_is_gone_would_be_found() -> None:
    text = "see `docs/no_such.md`, `python -m services.nothing`, `pytest tests/docs/test_paths.py -k x`, `docs/NAME.md`"
    assert _files(text) == ["docs/no_such.md", "tests/docs/test_paths.py"]
    assert _modules(text) == ["services.nothing"] and not _is_module("services.nothing")
    assert _is_module("crosspih_common.keys") and _is_module("crosspih_common.client.connect")
