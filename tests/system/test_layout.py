"""How the source is laid out: short files, no circles of imports, and a name that means one thing."""

from __future__ import annotations

import ast
from collections import defaultdict, deque
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from tests.system.source import ROOT, parsed
from tests.system.test_boundaries import PRODUCT, imported_in

MAX_LINES = 400


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in PRODUCT}


def at_module_level(tree: ast.Module) -> Iterator[ast.AST]:
    """Its nodes without the bodies of functions: what is imported there is imported when they are called."""
    left: deque[ast.AST] = deque([tree])
    while left:
        node = left.popleft()
        yield node
        within = node.body if isinstance(node, ast.FunctionDef) else []
        left.extend(child for child in ast.iter_child_nodes(node) if child not in within)


def needed_by(module: str) -> Iterator[str]:
    """Our modules that one imports when it is loaded, or names for the type checker; not the package it is in."""
    path = MODULES[module]
    for name in imported_in(at_module_level(parsed(path)), path):
        # `from package import name`: both are given, and only the name's module is what is meant where there is one
        if name in MODULES and name != module and not module.startswith(f"{name}."):
            yield name


def test_no_modules_import_each_other_in_a_circle() -> None:
    """A package that hands on the names of its modules is left out: it is loaded before all that is in it."""
    modules = [name for name, path in MODULES.items() if path.name != "__init__.py"]
    graph = {module: [name for name in needed_by(module) if name in modules] for module in modules}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as circle:
        raise AssertionError(" <- ".join(circle.args[1])) from None


def test_a_public_class_name_is_given_once() -> None:
    where = defaultdict(list)
    for path in PRODUCT:
        for node in parsed(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                where[node.name].append(path.relative_to(ROOT).as_posix())
    assert not {name: paths for name, paths in where.items() if len(paths) > 1}


def test_no_file_is_long() -> None:
    lines = {path: path.read_text(encoding="utf-8").count("\n") for path in PRODUCT}
    assert not {path.relative_to(ROOT).as_posix(): count for path, count in lines.items() if count > MAX_LINES}
