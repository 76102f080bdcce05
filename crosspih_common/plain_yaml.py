"""A strict YAML loader. PyYAML's safe loader accepts likely mistakes: of a setting that is given twice the last one
counts without a warning, 010 is 8, 1:30 is 90, and ten lines of aliases can expand beyond any memory. Here these are
errors that name the line, and so are texts on which the loader itself fails.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

MAX_BYTES = 1_000_000  # of a file that a person writes
MAX_VALUES = 200_000  # once all aliases are followed


class NotMeant(yaml.MarkedYAMLError):
    """Invalid YAML, or YAML that is surely a mistake; the text is one line and names the line in the file."""

    def __str__(self) -> str:
        mark = self.problem_mark
        where = "" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: "
        return where + " ".join(str(self.problem).split())


class _Loader(yaml.SafeLoader):
    """SafeLoader without the traps."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        said: dict[tuple[str, str], yaml.Node] = {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != "tag:yaml.org,2002:merge":
                first = said.setdefault((key.tag, key.value), key)
                if first is not key:
                    raise NotMeant(
                        problem=f"{key.value} is said twice, here and in line {first.start_mark.line + 1}; leave one",
                        problem_mark=key.start_mark,
                    )
        return super().construct_mapping(node, deep)


def _number(loader: _Loader, node: yaml.ScalarNode) -> Any:
    text = str(node.value).lstrip("+-")
    if ":" in text or (text[:1] == "0" and text[1:2].isdigit() and "." not in text and "e" not in text.lower()):
        meant = "minutes or degrees" if ":" in text else "an octal number"
        raise NotMeant(
            problem=f"{node.value} is {meant} in YAML; write a decimal number, or a text in quotes",
            problem_mark=node.start_mark,
        )
    if node.tag.endswith(":int"):
        return loader.construct_yaml_int(node)
    return loader.construct_yaml_float(node)


for _kind in ("int", "float"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", _number)


def yaml_of(text: str) -> Any:
    """The content of a text with one document; None if it is empty. Raises yaml.YAMLError that names the line."""
    try:
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            _sized(node)
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except RecursionError:
        raise NotMeant(problem="is nested deeper than anything that is meant") from None
    except NotMeant:
        raise
    except yaml.MarkedYAMLError as error:
        # the full message prints the line and a marker below it, which does not fit one line of a log
        raise NotMeant(problem=error.problem, problem_mark=error.problem_mark) from None
    except ValueError as error:  # an invalid date, a number of 5,000 digits
        raise NotMeant(problem=" ".join(str(error).split())) from None


def require_regular(path: Path) -> os.stat_result:
    """The stat result of a regular file. Raises OSError for pipes (a read would block) and devices (without an end)."""
    about = path.stat()
    if stat.S_ISDIR(about.st_mode):
        raise IsADirectoryError(errno.EISDIR, "Is a directory", str(path))
    if not stat.S_ISREG(about.st_mode):
        raise OSError(errno.EINVAL, "is no regular file", str(path))
    return about


def text_of_file(path: Path, most_bytes: int | None = None) -> str:
    """The UTF-8 text of a regular file, of `most_bytes` at most. Raises OSError, also if it is not UTF-8."""
    about = require_regular(path)
    if most_bytes is not None and about.st_size > most_bytes:
        raise OSError(errno.EFBIG, f"has {about.st_size} bytes, {most_bytes} are allowed", str(path))
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise OSError(errno.EILSEQ, f"is no text in UTF-8: byte {error.start}", str(path)) from None


def _sized(root: yaml.Node) -> None:
    """Raises NotMeant if the document is too large after expanding all aliases, or an alias contains itself."""
    counts: dict[int, int] = {}
    under_way: set[int] = set()

    def count(node: yaml.Node) -> int:
        if id(node) in counts:
            return counts[id(node)]
        if id(node) in under_way:
            raise NotMeant(problem="an alias stands for what it lies in", problem_mark=node.start_mark)
        under_way.add(id(node))
        total = 1
        if isinstance(node, yaml.SequenceNode):
            total += sum(count(one) for one in node.value)
        elif isinstance(node, yaml.MappingNode):
            total += sum(count(key) + count(value) for key, value in node.value)
        under_way.discard(id(node))
        if total > MAX_VALUES:
            raise NotMeant(
                problem=f"stands for more than {MAX_VALUES} values once its aliases are followed",
                problem_mark=node.start_mark,
            )
        counts[id(node)] = total
        return total

    count(root)
