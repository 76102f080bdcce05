"""The version of the code behind a figure: one hash over the sources that can change a trial's outcome."""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from importlib import metadata
from pathlib import Path

import crosspih_common

# services that only start, show, keep or count cannot change how a trial ends
_NO_SAY = ("operator", "recorder", "router", "foxglove", "viewer")
_COMMON_NO_SAY = ("foxglove", "client")  # of crosspih_common: output for viewers, and the client
# of the operator, these count: the request of a trial, its cell, and its scoring
SCORED_BY = (
    "scoring/score.py",
    "scoring/challenge_score.py",
    "assembly/session.py",
    "bench/cells/own_cell.py",
)
ASKED_BY = ("cell.py", "assembly_request.py")  # of crosspih_common/client
_LIBRARIES = ("numpy", "scipy", "pybullet", "mujoco", "opencv-python-headless", "torch", "pin", "coal", "shapely")


_WANTED = {".py", ".safetensors", ".json", ".yaml", ".npz", ".xml"}


def _without_docstrings(text: str) -> str:
    """A Python source as its syntax tree: comments, layout and docstrings do not count."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                node.body = node.body[1:]
    return ast.dump(tree)


def _sources(root: Path, further: tuple[str, ...] = ()) -> list[Path]:
    shown = {root / "crosspih_common" / name for name in _COMMON_NO_SAY}
    found = [path for path in (root / "crosspih_common").rglob("*") if shown.isdisjoint(path.parents)]
    for folder in sorted((root / "services").iterdir()):
        if folder.is_dir() and folder.name not in _NO_SAY:
            found += folder.rglob("*")
    found += [root / "services" / "operator" / name for name in SCORED_BY]
    found += [root / "crosspih_common" / "client" / name for name in ASKED_BY]
    return sorted({*(path for path in found if path.suffix in _WANTED and path.is_file()), *_chosen(root, further)})


def _chosen(root: Path, modules: tuple[str, ...]) -> list[Path]:
    found: list[Path] = []
    for module in modules:
        path = root.joinpath(*module.split("."))
        found += path.rglob("*") if path.is_dir() else [path.with_suffix(".py")]
    return sorted({path for path in found if path.suffix in _WANTED and path.is_file()})


def _digested(root: Path, path: Path) -> bytes:
    if path.suffix == ".py":
        content = _without_docstrings(path.read_text(encoding="utf-8")).encode()
    else:
        content = path.read_bytes()
    return f"{path.relative_to(root).as_posix()}\n".encode() + content


def _version(library: str) -> str:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return "none"


def _of_libraries() -> hashlib._Hash:
    digest = hashlib.sha256()
    for library in _LIBRARIES:
        digest.update(f"{library} {_version(library)}\n".encode())
    return digest


def hash_sources(root: Path, *further: str) -> str:
    """Sixteen hex digits over the sources below `root` and the versions of the numerical libraries.

    `further`: additional modules or packages that count, such as services.operator.dataset.contact.
    """
    digest = _of_libraries()
    for path in _sources(root, further):
        digest.update(_digested(root, path))
    return digest.hexdigest()[:16]


def _root() -> Path:
    return Path(next(iter(crosspih_common.__path__))).resolve().parent


@cache
def part_version(*modules: str, libraries: tuple[str, ...] = ()) -> str:
    """Sixteen hex digits over these modules and packages alone and the versions of these libraries: for results that
    depend on a part of the code and take hours to make.
    """
    root = _root()
    digest = hashlib.sha256(" ".join(f"{library} {_version(library)}" for library in libraries).encode())
    for path in _chosen(root, modules):
        digest.update(_digested(root, path))
    return digest.hexdigest()[:16]


@cache
def folder_version(folder: str, root: Path | None = None) -> str:
    """As `code_version`, over one folder alone, such as `crosspih_common` or `services/vision`: for results that depend
    on less code than a trial. Computed once a process."""
    root = root or _root()
    digest = _of_libraries()
    for path in _chosen(root, (folder.replace("/", "."),)):
        digest.update(_digested(root, path))
    return digest.hexdigest()[:16]


@cache
def code_version(*further: str) -> str:
    """`hash_sources` of the running code; computed once a process."""
    return hash_sources(_root(), *further)


class SourceWatch:
    """Watches whether the sources below `root` are still those of a version: a stack started later runs the new ones.

    It compares times and sizes, and hashes the sources again only if these have changed.
    """

    def __init__(self, root: Path | None = None, version: str | None = None, further: tuple[str, ...] = ()) -> None:
        self._root = root or _root()
        self._further = further
        self._version = version or code_version(*further)
        self._same = True
        self._stamps: dict[Path, tuple[int, int]] = {}

    def unchanged(self) -> bool:
        """Whether the sources are unchanged. Cheap to call; once False it stays False."""
        if self._same:
            stamps = {
                path: (about.st_mtime_ns, about.st_size)
                for path in _sources(self._root, self._further)
                if (about := path.stat())
            }
            if stamps != self._stamps:
                self._stamps = stamps
                self._same = hash_sources(self._root, *self._further) == self._version
        return self._same
