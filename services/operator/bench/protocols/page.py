"""Reads the steps of a docs page: commands, and lines for the cell's file, in order. Pure."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from typing import Any, Literal

import yaml

from crosspih_common.plain_yaml import yaml_of

BLOCK = re.compile(r"^```(sh|yaml)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^## (\d+)\. (.*)$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class PageStep:
    """One step. `words` of a command or an export (name, value), `lines` for a cell's file."""

    kind: Literal["command", "export", "file"]
    section: int
    words: tuple[str, ...] = ()
    lines: dict[str, Any] | None = None

    @property
    def text(self) -> str:
        """In one line."""
        return " ".join(self.words) if self.kind != "file" else f"the file: {yaml.safe_dump(self.lines).split(':')[0]}"


def steps_of(page: str) -> list[PageStep]:
    """The steps of the numbered sections. Raises ValueError for a block that cannot be read."""
    headings = [(match.start(), int(match[1])) for match in HEADING.finditer(page)]
    end = len(page)
    if headings:
        after = re.search(r"^## (?!\d+\.)", page[headings[-1][0] :], re.MULTILINE)
        end = end if after is None else headings[-1][0] + after.start()
    steps = []
    for block in BLOCK.finditer(page):
        section = max((number for start, number in headings if start < block.start()), default=0)
        if section == 0 or block.start() > end:
            continue
        if block[1] == "yaml":
            lines = yaml_of(block[2])
            if not isinstance(lines, dict):
                raise ValueError(f"section {section}: a block of YAML is no mapping")
            steps.append(PageStep("file", section, (), lines))
            continue
        for line in block[2].replace("\\\n", " ").splitlines():
            words = tuple(shlex.split(line, comments=True))
            if words[:1] == ("export",):
                name, _, value = words[1].partition("=")
                steps.append(PageStep("export", section, (name, value)))
            elif words:
                steps.append(PageStep("command", section, words))
    return steps
