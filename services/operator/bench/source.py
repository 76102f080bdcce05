"""What code made a figure: one hash over the sources on which a trial's outcome rests."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from pathlib import Path

import crosspih_common

# what only starts, shows, keeps or counts has no say in how a trial ends
_NO_SAY = ("operator", "recorder", "router")
_SCORED_BY = ("scoring.py", "session.py")
_WANTED = frozenset([".py", ".safetensors", ".json", ".yaml", ".npz"])
_LIBRARIES = ("numpy", "scipy", "pybullet", "opencv-python-headless", "torch")


def _without_docstrings(text: str) -> str:
    """A Python source as its syntax tree: comments, layout and docstrings do not count."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                node.body = node.body[1:]
    return ast.dump(tree)


def _sources(root: Path) -> list[Path]:
    found = list((root / "crosspih_common").rglob("*"))
    for folder in sorted((root / "services").iterdir()):
        if folder.is_dir() and folder.name not in _NO_SAY:
            found += folder.rglob("*")
    found += [root / "services" / "operator" / name for name in _SCORED_BY]
    return _read_from(found)


def _read_from(found: Iterable[Path]) -> list[Path]:
    return sorted(path for path in found if path.suffix in _WANTED and path.is_file())


def _version(library: str) -> str:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return "none"


def hash_sources(root: Path) -> str:
    """Sixteen hex digits over the sources below `root` and the versions of the numerical libraries."""
    return _hash(root, _sources(root))


def _hash(root: Path, paths: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for library in _LIBRARIES:
        digest.update(f"{library} {_version(library)}\n".encode())
    for path in paths:
        digest.update(f"{path.relative_to(root).as_posix()}\n".encode())
        if path.suffix == ".py":
            digest.update(_without_docstrings(path.read_text(encoding="utf-8")).encode())
        else:
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _root() -> Path:
    return Path(next(iter(crosspih_common.__path__))).resolve().parent


@cache
def code_version() -> str:
    """`hash_sources` of the code that runs here; taken once a process."""
    return hash_sources(_root())


@cache
def folder_version(folder: str, root: Path | None = None) -> str:
    """As `code_version`, over all of one folder alone, such as `crosspih_common` or `services/vision`: for what rests
    on less than a trial does. Taken once a process."""
    root = root or _root()
    return _hash(root, _read_from((root / folder).rglob("*")))


class SourceWatch:
    """Whether the sources below `root` are still those of a version: a stack that starts late runs what is there then.

    It looks at times and sizes, and reads the sources again only where these have changed.
    """

    def __init__(self, root: Path | None = None, version: str | None = None) -> None:
        self._root = root or _root()
        self._version = version or code_version()
        self._same = True
        self._stamps: dict[Path, tuple[int, int]] = {}

    def unchanged(self) -> bool:
        """Ask as often as you like; once changed it stays so."""
        if self._same:
            stamps = {
                path: (about.st_mtime_ns, about.st_size) for path in _sources(self._root) if (about := path.stat())
            }
            if stamps != self._stamps:
                self._stamps = stamps
                self._same = hash_sources(self._root) == self._version
        return self._same
