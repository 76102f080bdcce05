"""`crosspih bench vision --pictures`: every pair of a folder, row by row."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from crosspih_common.errors import CrosspihError
from services.operator.bench.cells.bar import Bar
from services.operator.bench.pictures.command import RENDERED, SMALL
from services.operator.bench.pictures.judging.asking import answers
from services.operator.bench.pictures.judging.verdicts import PicturesReport, PictureVerdict, figures
from services.operator.bench.pictures.kept import shots

NAMED = "rendered"


def folder_of(pictures: str, console: Console) -> Path:
    """The folder that `--pictures` names. Raises CrosspihError."""
    if pictures != NAMED:
        return Path(pictures)
    if (RENDERED / shots.SET).is_file():
        return RENDERED
    if (SMALL / shots.SET).is_file():
        console.print(
            f"{RENDERED} is not there: this is the small set of {SMALL}; `crosspih bench pictures` makes the whole",
            style="yellow", highlight=False,
        )  # fmt: skip
        return SMALL
    raise CrosspihError(
        f"--pictures {NAMED}: there is neither {RENDERED} nor {SMALL}; make them: crosspih bench pictures"
    )


def bench_pictures(
    pictures: str, rows: str | None, pairs: int | None, annotated: Path | None, beside: bool, console: Console
) -> PicturesReport:
    """Judge what vision says of a folder's pairs, at most `pairs` a row. Raises CrosspihError."""
    folder = folder_of(pictures, console)
    named = None if rows is None else [name.strip() for name in rows.split(",") if name.strip()]
    wanted = shots.wanted_from(folder, named, pairs)
    each: list[PictureVerdict] = []
    with Bar(console) as progress:
        task = progress.add_task("pictures", total=len(wanted))
        for verdict in answers(wanted, annotated, beside):
            each.append(verdict)
            progress.update(task, advance=1, description=verdict.row)
    names = list(dict.fromkeys(one.row for one in each))
    by_row = [figures(name, [one for one in each if one.row == name]) for name in names]
    return PicturesReport(pictures=str(folder), rows=by_row, all=figures("all", each), each=each)
