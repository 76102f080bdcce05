"""`crosspih replay FILE`: does today's service answer what it answered then?"""

from __future__ import annotations

import json
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from crosspih_common.errors import ConfigError
from crosspih_common.recording import Recording, read_recording
from services.operator.bench.options import AsJson, errors_shown
from services.operator.recordings.replay.answers import Compared, answers, stored_cell
from services.operator.recordings.replay.cores import CORES, again, all_equal, summary
from services.operator.recordings.replay.requests import COMMANDS, TOPICS, requests_of

SERVICES = (*COMMANDS, *CORES)
ROWS = 12  # at most this many of a core's differences are shown


def replay(
    file: Annotated[Path, typer.Argument(help="A recording (.mcap), also one that was torn off.")],
    from_s: Annotated[float, typer.Option("--from", min=0.0, help="Begin this many seconds after its start.")] = 0.0,
    service: Annotated[str | None, typer.Option(help=f"{', '.join(SERVICES)}; all when left out.")] = None,
    cell: Annotated[Path | None, typer.Option(help="Another cell's file than the one in the recording.")] = None,
    as_json: AsJson = False,
) -> None:
    """Have vision, inference, force/torque and planning answer and decide again on what a recording holds, and compare
    bit for bit.

    Status 1 where something differs.
    """
    console = Console(stderr=as_json)
    with errors_shown(console):
        if service is not None and service not in SERVICES:
            raise ConfigError(f"--service {service}: want one of {', '.join(SERVICES)}")
        recording = read_recording(file, TOPICS)
        content = stored_cell(recording, cell)
        for line in _notes(recording):
            console.print(line, highlight=False, markup=False)
        found: list[tuple[str, Compared]] = []
        outcomes: dict[str, dict[str, Any]] = {}
        for name in [service] if service else list(SERVICES):
            if name in CORES:
                outcomes[name] = again(name, content, file, from_s)
                for line in (summary(name, outcomes[name]), *outcomes[name]["notes"]):
                    console.print(line, highlight=False, markup=False)
                continue
            requests = requests_of(recording, name, from_s)
            if not requests:
                console.print(f"{name}: was asked nothing", highlight=False)
                continue
            here = list(answers(name, content, recording, requests))
            found += [(name, compared) for compared in here]
            console.print(_summary(name, here), highlight=False)
        if not found and not any(outcome["parts"] for outcome in outcomes.values()):
            raise ConfigError(f"{file}: after {from_s:g} s nothing in it can be asked again")
        different = [(name, compared) for name, compared in found if not compared.equal]
        unlike = {name: outcome for name, outcome in outcomes.items() if not all_equal(outcome)}
        if as_json:
            listed: list[dict[str, Any]] = [_as_json(name, compared) for name, compared in found]
            listed += [{"service": name, "equal": name not in unlike, **outcome} for name, outcome in outcomes.items()]
            json.dump(listed, sys.stdout, indent=1)
            print()
        else:
            if different:
                console.print(_table(different))
            for name, outcome in unlike.items():
                console.print(_core_table(name, outcome["differences"]))
        if different or unlike:
            raise typer.Exit(1)


def _core_table(name: str, rows: list[dict[str, Any]]) -> Table:
    more = f", the first {ROWS} of {len(rows)}" if len(rows) > ROWS else ""
    table = Table("at s", "what", "field", "then", "now", "differs by", title=f"{name}: what differs{more}")
    for row in rows[:ROWS]:
        by = "" if row["by"] is None else f"{row['by']:.3g}"
        table.add_row(f"{row['at_s']:.3f}", row["asked"], row["field"], row["then"], row["now"], by)
    return table


def _notes(recording: Recording) -> list[str]:
    """Possible reasons for a difference: a torn file, and other versions than in the recording."""
    notes = (
        [] if recording.finished else [f"{recording.path}: is damaged ({recording.tear}); its undamaged part is used"]
    )
    changed = []
    for name, then in recording.metadata.get("versions", {}).items():
        try:
            here = version(name)
        except PackageNotFoundError:
            continue
        if here != then:
            changed.append(f"{name} {then}, here {here}")
    return [*notes, *([f"recorded with {'; '.join(changed)}"] if changed else [])]


def _summary(name: str, compared: list[Compared]) -> str:
    given = [one for one in compared if one.asked.answer is not None]
    equal = sum(one.equal for one in given)
    rest = len(compared) - len(given)
    again = sum(one.equal for one in compared if one.asked.answer is None)
    text = f"{name}: {equal} of {len(given)} recorded answers are equal bit for bit"
    return text + (f"; of {rest} requests without a recorded answer {again} are refused now too" if rest else "")


def _table(different: list[tuple[str, Compared]]) -> Table:
    table = Table("at s", "asked", "field", "then", "now", "differs by", title="answers that differ")
    for _, one in different:
        for index, row in enumerate(one.differences):
            first = (f"{one.asked.at_s:.3f}", one.asked.command.path) if index == 0 else ("", "")
            table.add_row(*first, row.field, row.then, row.now, "" if row.by is None else f"{row.by:.3g}")
    return table


def _as_json(name: str, one: Compared) -> dict[str, object]:
    return {
        "service": name,
        "command": one.asked.command.path,
        "at_s": one.asked.at_s,
        "equal": one.equal,
        "refused": one.refused,
        "differences": [row.as_json() for row in one.differences],
    }
