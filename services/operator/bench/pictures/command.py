"""`crosspih bench pictures`: render the scenes of the rows into a store; what is there is not done again."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from crosspih_common.config import Workcell
from crosspih_common.errors import CrosspihError
from crosspih_common.provenance import part_version
from services.operator.bench.cells.bar import Bar
from services.operator.bench.options import errors_shown
from services.operator.bench.pictures.judging.verdicts import RENDERED_BY
from services.operator.bench.pictures.kept import shots, store
from services.operator.bench.pictures.kept.sets import NAMED_SEEDS, ROWS, SceneName, pairs_of, scene_of
from services.operator.bench.pictures.tracing import renderer
from services.operator.bench.pictures.tracing.rendering import render

# what a scene's light rests on, of this package
MAKERS = ("camera.cameras", "kept.sets", "scenes", "tracing")
RENDERED = Path("results/pictures")
SMALL = Path("tests/pictures/set")


def rows_named(rows: str | None) -> list[str]:
    """The rows of a list with commas; all when there is none. Raises CrosspihError."""
    names = list(ROWS) if rows is None else [name.strip() for name in rows.split(",") if name.strip()]
    if unknown := [name for name in names if name not in ROWS]:
        raise CrosspihError(f"--rows: there is no row {unknown[0]!r}; there are {', '.join(ROWS)}")
    return names


def seed_named(seed: str) -> int:
    """A set's seed by name or number. Raises CrosspihError."""
    if seed in NAMED_SEEDS:
        return NAMED_SEEDS[seed]
    if not seed.isdigit() or int(seed) >= 90_000:
        raise CrosspihError(f"--seed: {seed!r} is neither {', '.join(NAMED_SEEDS)} nor a number below 90000")
    return int(seed)


def scenes_for(rows: list[str], seed: int, share: float) -> list[SceneName]:
    """The scenes that the rows need, each once: the first of every row, then the second, so that a set that was broken
    off holds something of each."""
    wanted = [(index, scene_of(ROWS[name], index, seed)) for name in rows for index in range(pairs_of(name, share))]
    wanted.sort(key=lambda one: one[0])
    return list(dict.fromkeys(scene for _, scene in wanted))


def kept_about(folder: Path, seed: int, share: float, rows: list[str]) -> dict[str, Any]:
    """What `set.json` says of the folder, these rows added. Raises CrosspihError where it holds another set."""
    path = folder / shots.SET
    about: dict[str, Any] = {"seed": seed, "share": share, "rows": rows}
    if path.is_file():
        there = json.loads(path.read_text(encoding="utf-8"))
        if (there["seed"], there["share"]) != (seed, share):
            raise CrosspihError(
                f"{folder} holds the set of seed {there['seed']}, share {there['share']}; name another --out"
            )
        about["rows"] = [name for name in ROWS if name in rows or name in there["rows"]]
    return about


def make_scene(scene: SceneName, folder: Path, small: bool = False) -> bool:
    """Render one scene into the store; False where it is there already."""
    path = folder / shots.SCENES / scene.file
    if path.is_file():
        return False
    spec, pair, care = scene.drawn()
    rendered = render(spec, Workcell(), pair, scene.seed, care)
    store.save(path, replace(rendered, truth={**rendered.truth, RENDERED_BY: renderer_version()}), small)
    return True


@cache
def renderer_version() -> str:
    """Sixteen hex digits over what makes a scene's light from its name; each scene says by which it was made."""
    return part_version(
        *(f"services.operator.bench.pictures.{name}" for name in MAKERS), "crosspih_common.shapes",
        libraries=("mitsuba", "numpy", "opencv-python-headless"),
    )  # fmt: skip


def by_renderer(folder: Path, scenes: list[SceneName]) -> Counter[str]:
    """How many of these scenes are there, by the renderer's code that made them; '' where a scene does not say."""
    paths = [folder / shots.SCENES / scene.file for scene in scenes]
    return Counter(store.truth_of(path).get(RENDERED_BY, "") for path in paths if path.is_file())


def make_pictures(
    out: Annotated[Path, typer.Option(help="The store: scenes are added, those that are there are kept.")] = RENDERED,
    rows: Annotated[str | None, typer.Option(help="Rows of the table, with commas; all when left out.")] = None,
    seed: Annotated[str, typer.Option(help="The set: dev, held, or a number.")] = "dev",
    share: Annotated[float, typer.Option(min=0.01, max=100.0, help="Of the usual number of pairs a row.")] = 1.0,
    png: Annotated[Path | None, typer.Option(help="A folder that gets the pairs as PNG, with truth.json.")] = None,
    small: Annotated[bool, typer.Option("--small", help="8 bits instead of 12: a third of the size.")] = False,
    variant: Annotated[str, typer.Option(help="Mitsuba's variant; llvm_ad_rgb wants LLVM 16+.")] = renderer.VARIANT,
) -> None:
    """Render pictures of a workshop with their truth by a path tracer, for `crosspih bench vision --pictures`."""
    console = Console(stderr=True)
    with errors_shown(console):
        named, number = rows_named(rows), seed_named(seed)
        renderer.use(variant)
        about = kept_about(out, number, share, named)
        scenes = scenes_for(named, number, share)
        (out / shots.SCENES).mkdir(parents=True, exist_ok=True)
        others = by_renderer(out, scenes)
        others.pop(renderer_version(), None)
        if others:
            said = ", ".join(f"{count} by {name or 'one that is not said'}" for name, count in others.items())
            said = f"{out}: scenes of other renderers' code are kept and are not made anew: {said}; this is"
            console.print(f"{said} {renderer_version()}", style="yellow", highlight=False, soft_wrap=True)
        (out / shots.SET).write_text(json.dumps(about, indent=1), encoding="utf-8")
        with Bar(console) as progress:
            task = progress.add_task("scenes", total=len(scenes))
            for scene in scenes:
                progress.update(task, description=scene.group)
                try:
                    make_scene(scene, out, small)
                except CrosspihError as error:
                    if str(error) == renderer.EXTRA:
                        raise
                    progress.console.print(f"{scene.file}: {error}", style="yellow", markup=False, highlight=False)
                progress.advance(task)
            if png is not None:
                _write_png(out, named, png, progress)
        held = shots.wanted_from(out, None, None)
        console.print(f"{out}: {len(held)} pairs of {len({one.row for one in held})} rows", highlight=False)


def _write_png(out: Path, rows: list[str], folder: Path, progress: Bar) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    truths: dict[str, Any] = {}
    wanted = shots.wanted_from(out, rows, None)
    task = progress.add_task("pairs", total=len(wanted))
    for one in wanted:
        shots.write_pair(one.load(), folder, truths)
        progress.advance(task)
    (folder / shots.TRUTH).write_text(json.dumps(truths, indent=1), encoding="utf-8")
