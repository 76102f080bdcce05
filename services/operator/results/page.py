"""docs/results.md from the output of the commands. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from services.operator.results.plan import PlannedSection
from services.operator.results.printed import Printed

_PICTURE = re.compile(r"\S+\.(?:png|svg)")
_BY_PYBULLET = "argv[0]="  # the C code of a client prints this line at every start
# the last line of a section; its older wording gave the time of printing known results as that of measuring them
_LAST = re.compile(r"^(?P<said>(?:Measured|Printed|Last run).*code (?P<code>[0-9a-f]{16})[^;.]*)(?P<rest>.*)$")
_CHANGED, _OTHER_COMMAND = "; the code has changed since", "; the command is another one since"


@dataclass(frozen=True)
class SectionCounts:
    """How many sections of a page are by the code that runs, by other code, or missing."""

    this: int
    other: int
    missing: int

    def said(self, code: str) -> str:
        """The counts in words."""
        whole = self.this + self.other + self.missing
        return f"{self.this} of {whole} sections are by code {code}, {self.other} by other code, {self.missing} not run"


def duration(seconds: float) -> str:
    """For people."""
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60:02d} min"


def _days(first: str, last: str) -> str:
    days = list(dict.fromkeys(text[:10] for text in (first, last) if text))
    return " to ".join(days)


def when(printed: Printed) -> str:
    """When and how long it was measured: results taken over from a store count with their own times."""
    here = f"{duration(printed.elapsed_s)} on {printed.cores} cores"
    if not printed.taken:
        return f"Measured in {here}" + (f", {printed.at[:10]}" if printed.at else "")
    before = f"{printed.taken} results were measured before"
    if days := _days(printed.first, printed.last):
        before += f", {days}"
    if printed.taken_s is not None:
        before += f", in {duration(printed.taken_s)} one after the other"
    if printed.made:
        return f"Measured: {printed.made} results in {here}, {printed.at[:10]}; {before}"
    return f"Printed from the store in {duration(printed.elapsed_s)}; its {before}"


def _section(entry: PlannedSection, printed: Printed, planned: str, code: str) -> list[str]:
    lines = [f"## {entry.title}", ""]
    if entry.says:
        lines += [entry.says, ""]
    said_by_us = [line for line in printed.text.rstrip().splitlines() if line != _BY_PYBULLET]
    lines += ["```sh", printed.command, "```", "", "```text", *said_by_us, "```", ""]
    for picture in _PICTURE.findall(printed.command):
        # the page is one folder above its pictures
        name = picture.rsplit("/", 2)
        lines += [f"![{entry.title}]({'/'.join(name[-2:])})", ""]
    said = f"{when(printed)}, code {printed.code}"
    if printed.status != 0:
        said += f"; **it ended with status {printed.status}**"
    return [*lines, _marked(f"{said}.", printed.command, planned, code), ""]


def _marked(last: str, command: str, planned: str, code: str) -> str:
    """A section's last line, with a note on what has changed since it was printed."""
    found = _LAST.match(last)
    if found is None:
        return last
    rest = found["rest"].rstrip(".").replace(_CHANGED, "").replace(_OTHER_COMMAND, "")
    changed = _CHANGED if found["code"] != code else ""
    return found["said"] + rest + changed + (_OTHER_COMMAND if command != planned else "") + "."


def sections_of(page: str) -> dict[str, list[str]]:
    """The sections of an earlier page, by title: the lines from the title on."""
    found: dict[str, list[str]] = {}
    lines: list[str] | None = None
    for line in page.splitlines():
        if line.startswith("## "):
            lines = found.setdefault(line[3:], [])
        if lines is not None:
            lines.append(line)
    return found


def _kept(entry: PlannedSection, lines: list[str] | None, folder: str, code: str) -> list[str] | None:
    """A section of the page as it was; None where there was none, or where nothing was run for it."""
    if lines is None or not any(_LAST.match(line) for line in lines):
        return None
    command = lines[lines.index("```sh") + 1] if "```sh" in lines else ""
    return [_marked(line, command, entry.shown(folder), code) for line in lines]


def make_page(
    entries: Sequence[PlannedSection],
    printed: Mapping[str, Printed],
    folder: str,
    code: str,
    before: str = "",
    quick: bool = False,
) -> tuple[str, SectionCounts]:
    """The whole page, and how much of it is by which code.

    folder: of the pictures, as the commands name it. code: the version that runs now. before: the present page; a
    section that was not run here is kept from it, because a fresh clone has the page but not the output behind it.
    quick: the commands are those of small runs.
    """
    known = sections_of(before)
    body: list[str] = []
    this = missing = 0
    for entry in entries:
        if (found := printed.get(entry.name)) is not None:
            planned = entry.shown(folder, tuple(entry.quick.split()) if quick else ())
            lines: list[str] | None = _section(entry, found, planned, code)
        else:
            lines = _kept(entry, known.get(entry.title), folder, code)
        if lines is None:
            lines = [f"## {entry.title}", "", *([entry.says, ""] if entry.says else [])]
            lines += ["```sh", entry.shown(folder), "```", "", "Not run yet.", ""]
            missing += 1
        this += any((last := _LAST.match(line)) is not None and last["code"] == code for line in lines)
        body += [*lines, ""] if lines[-1] else lines
    counts = SectionCounts(this, len(entries) - this - missing, missing)
    return "\n".join([*_head(counts, code), *body]).rstrip() + "\n", counts


def _head(counts: SectionCounts, code: str) -> list[str]:
    return [
        "# Results",
        "",
        "Made by `make results` from `services/operator/results/plan.yaml`: each section is a command and what it",
        "printed. Trials are kept in `results/trials.jsonl`; a stopped run goes on from there. `code` is a hash of the",
        "sources on which the figures rest; a section by other code than today's says so. `Measured` is the time of",
        "the measurement; of sections that say `Last run` it is that of the last printing, which may have taken",
        "results over. All of it is simulation: no figure here comes from a real arm.",
        "",
        f"{counts.said(code)}.",
        "",
    ]
