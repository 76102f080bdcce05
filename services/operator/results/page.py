"""docs/results.md from what the commands printed. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from services.operator.results.plan import Entry
from services.operator.results.printed import Printed

_PICTURE = re.compile(r"\S+\.(?:png|svg)")
_BY_PYBULLET = "argv[0]="  # its C code prints this line with every client it opens


def duration(seconds: float) -> str:
    """For people."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60:02d} min"


def _section(entry: Entry, printed: Printed | None, folder: str, code: str) -> list[str]:
    lines = [f"## {entry.title}", ""]
    if entry.says:
        lines += [entry.says, ""]
    if printed is None:
        return [*lines, "```sh", entry.shown(folder), "```", "", "Not run yet.", ""]
    said_by_us = [line for line in printed.text.rstrip().splitlines() if line != _BY_PYBULLET]
    lines += ["```sh", printed.command, "```", "", "```text", *said_by_us, "```", ""]
    for picture in _PICTURE.findall(printed.command):
        # the page lies one folder above its pictures
        name = picture.rsplit("/", 2)
        lines += [f"![{entry.title}]({'/'.join(name[-2:])})", ""]
    said = f"Last run: {duration(printed.elapsed_s)} on {printed.cores} cores, code {printed.code}"
    if printed.status != 0:
        said += f"; **it ended with status {printed.status}**"
    if printed.code != code:
        said += "; the code has changed since"
    return [*lines, f"{said}.", ""]


def make_page(entries: Sequence[Entry], printed: Mapping[str, Printed], folder: str, code: str) -> str:
    """The whole page. `folder`: of the pictures, as it stands in the commands. `code`: the version that runs now."""
    lines = [
        "# Results",
        "",
        "Made by `make results` from `services/operator/results/plan.yaml`: each section is a command and what it",
        "printed. Trials are kept in `results/trials.jsonl`; a stopped run goes on from there, and one that finds them",
        "all is over at once. `code` is a hash of the sources on which the figures rest. All of it is simulation: no",
        "figure here comes from a real arm.",
        "",
    ]
    for entry in entries:
        lines += _section(entry, printed.get(entry.name), folder, code)
    return "\n".join(lines).rstrip() + "\n"
