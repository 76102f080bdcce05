"""The commands `crosspih recording info|check|recover|cut|merge|animate`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from crosspih_common.errors import ConfigError
from services.operator.bench.options import AsJson, errors_shown
from services.operator.recordings import looking, making
from services.operator.recordings.making import MadeRecording

FILE_HELP = "A recording (.mcap); its further parts are found beside it."
File = Annotated[Path, typer.Argument(help=FILE_HELP)]
Out = Annotated[Path, typer.Argument(help="The file that is made (.mcap); it must not be there yet.")]


def info(file: File, as_json: AsJson = False) -> None:
    """What is in it: files, channels, rates, times, what is missing."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        found = looking.described(file)
        if as_json:
            json.dump(found, sys.stdout, indent=1)
            print()
            return
        _show(console, found)


def _show(console: Console, found: dict[str, Any]) -> None:
    console.print(
        f"{found['path']}: cell {found['cell'] or 'unknown'}, {found['messages']} messages, "
        f"{found['duration_s']:.1f} s of cell time, begun {found['started'] or 'nobody says when'}",
        highlight=False,
        soft_wrap=True,
    )
    for part in found["parts"]:
        state = "whole" if part["finished"] else "; ".join(part["damage"]) or "without an end"
        console.print(
            f"  {Path(part['path']).name}: {part['bytes'] / 1e6:.2f} MB, {part['messages']} messages, {state}",
            highlight=False,
        )
        for one in part["attachments"]:
            console.print(f"    attached: {one['name']} ({one['media_type']}, {one['bytes']} bytes)", highlight=False)
    table = Table("key", "type", "messages", "Hz", "from s", "to s", "missing")
    for column in table.columns[2:]:
        column.justify = "right"
    for row in found["channels"]:
        rate = "" if row["rate_hz"] is None else f"{row['rate_hz']:.1f}"
        table.add_row(
            "/".join(row["key"].split("/")[2:]) or row["key"], row["type"].removeprefix("crosspih."),
            str(row["messages"]), rate, f"{row['first_s']:.2f}", f"{row['last_s']:.2f}", str(row["missing"] or ""),
        )  # fmt: skip
    console.print(table)
    for key, count in found["drops"].items():
        console.print(f"{count:8d}  {key}", highlight=False)


def check(file: File, as_json: AsJson = False) -> None:
    """Is it whole? Its checks, counts, gaps, stamps, and whether all decodes. Status 1 where something is wrong."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        recording, found = looking.findings(file)
        messages = sum(len(samples) for samples in recording.samples.values())
        if as_json:
            json.dump({"messages": messages, "findings": [asdict(one) for one in found]}, sys.stdout, indent=1)
            print()
        for one in found:
            console.print(f"{one.what:13} {one.file}: {one.detail}", highlight=False, markup=False, soft_wrap=True)
        if found:
            raise typer.Exit(1)
        if not as_json:
            console.print(f"whole: {messages} messages in {len(recording.parts)} file(s)", highlight=False)


def recover(file: File, out: Out, as_json: AsJson = False) -> None:
    """Write all that is whole of a torn or damaged recording, before and behind the damage, as a whole one."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        made = making.recover(file, out)
        _told(console, as_json, made, out)


def cut(
    file: File,
    out: Out,
    from_s: Annotated[float | None, typer.Option("--from", help="s of cell time since it began.")] = None,
    to_s: Annotated[float | None, typer.Option("--to", help="s of cell time since it began.")] = None,
    assembly: Annotated[str | None, typer.Option(help="One assembly instead, by its number or its name.")] = None,
    as_json: AsJson = False,
) -> None:
    """Write a piece of a recording, and before it the states that were known then."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        if assembly is None and from_s is None and to_s is None:
            raise ConfigError("say what to cut out: --from, --to or --assembly")
        if assembly is not None and (from_s is not None or to_s is not None):
            raise ConfigError("--assembly says from when to when: leave --from and --to out")
        made = making.cut(file, out, *making.window(file, from_s, to_s, assembly))
        _told(console, as_json, made, out)


def merge(
    files: Annotated[list[Path], typer.Argument(help="Recordings (.mcap), each with its further parts.")],
    out: Annotated[Path, typer.Option("--output", "-o", help="The file that is made (.mcap).")],
    as_json: AsJson = False,
) -> None:
    """Write several recordings, or the parts of one, as one file in the order of the cell's time."""
    console = Console(stderr=as_json)
    with errors_shown(console):
        made = making.merge(files, out)
        _told(console, as_json, made, out)


def _told(console: Console, as_json: bool, made: MadeRecording, out: Path) -> None:
    damage = [(part.path.name, str(damage)) for part in made.parts for damage in part.damage]
    nameless = sum(part.nameless for part in made.parts)
    if as_json:
        said = {
            "path": str(out), "messages": made.messages, "of_parts": [str(part.path) for part in made.parts],
            "damage": [f"{name}: {text}" for name, text in damage], "nameless": nameless, "repeated": made.repeated,
        }  # fmt: skip
        json.dump(said, sys.stdout, indent=1)
        print()
        return
    for name, text in damage:
        console.print(f"{name}: {text}", highlight=False, markup=False, soft_wrap=True)
    if nameless:
        console.print(f"{nameless} undamaged messages are left out: their key was in a damaged part", highlight=False)
    if made.repeated:
        console.print(f"{made.repeated} messages were there more than once", highlight=False)
    console.print(f"{out}: {made.messages} messages", highlight=False, soft_wrap=True)
