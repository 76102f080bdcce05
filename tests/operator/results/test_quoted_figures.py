"""README and docs quote what docs/results.md holds: every figure that stands in both is compared."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from services.operator.bench.cells.trials import WALL_FIGURES
from services.operator.bench.compare.command import POOR
from services.operator.cli.commands import app
from services.operator.results.page import sections_of

NUMBER = re.compile(r"(?<![\w.])[+-]?\d*\.?\d+(?![\w])")
PAGE = {title: "\n".join(lines) for title, lines in sections_of(Path("docs/results.md").read_text("utf-8")).items()}
# a row of the page's table: the figure in the table of `crosspih bench assembly`
FIGURES = {
    "duration, motion and thinking, s": "duration_s",
    "touches": "touches",
    "corrections": "corrections",
    "peak force, N (largest of all)": "peak_force_n",
    "peak moment, Nm": "peak_moment_nm",
    "vision, across the axis, mm": "vision_error_mm",
    "vision, tilt, °": "vision_tilt_deg",
    "final pose T2, across the axis, mm": "final_error_mm",
    "final pose T2, rotation, °": "final_error_deg",
}
COLUMNS = ("The default cell", "Force alone, ±5 mm", "Force alone, ±10 mm")
README, HOW_GOOD, DATASETS = "README.md", "docs/how-good.md", "docs/datasets.md"
CLAIMS, STATES = "docs/paper-claims.md", "docs/contact-states.md"


def numbers(text: str) -> list[str]:
    return NUMBER.findall(text.replace(",", "") if re.fullmatch(r"[\d,]+", text) else text)


def row(title: str, name: str) -> list[str]:
    """The numbers of the first row of a section's tables that begins so."""
    for line in PAGE[title].splitlines():
        cells = [cell.strip() for cell in re.split("[│|┃]", line)[1:-1]]
        if cells and cells[0] == name:
            return numbers(" ".join(cells[1:]))
    raise AssertionError(f"{title}: no row {name}")


def inserted(title: str) -> list[str]:
    """How many of how many, as the table's title says."""
    found = re.search(r"(\d+)\s+of\s+(\d+)\s+inserted", PAGE[title])
    assert found is not None, title
    return list(found.groups())


def compared(condition: int, strategy: str, column: int) -> list[str]:
    """A cell of the tables of `bench compare`; the conditions are counted from good vision on."""
    table = PAGE["Strategies on the same seeds"].split("Wilson")[condition + 1]
    line = next(line for line in table.splitlines() if line.split()[:1] == [strategy])
    return numbers(line.split()[column].replace("/", " "))


def assert_quoted(quoted: list[str], held: list[str], where: str) -> None:
    """Each quoted number is the held one, rounded to the digits that are quoted."""
    assert len(quoted) == len(held), f"{where}: quotes {quoted}, results hold {held}"
    for said, known in zip(quoted, held, strict=True):
        half = 0.5 * 10.0 ** -len(said.partition(".")[2])
        least = 0.5 * 10.0 ** -len(known.partition(".")[2]) if "." in known else 0.0
        assert abs(float(said) - float(known)) <= half + least + 1e-9, f"{where}: quotes {said}, results hold {known}"


INSERTED = "inserted (95 % Wilson interval)"
SHORT = (
    INSERTED,
    "duration, motion and thinking, s",
    "peak force, N (largest of all)",
    "final pose T2, across the axis, mm",
)


@pytest.mark.parametrize(
    ("page", "line"), [*((HOW_GOOD, line) for line in (*FIGURES, INSERTED)), *((README, line) for line in SHORT)]
)
def test_a_pages_table_is_of_the_results(page: str, line: str) -> None:
    cells = next(
        text.split("|")[2:-1]
        for text in Path(page).read_text(encoding="utf-8").splitlines()
        if text.startswith(f"| {line} |")
    )
    for title, cell in zip(COLUMNS, cells, strict=True):
        if not cell.strip():
            continue
        if line in FIGURES:
            quoted = numbers(cell.replace("/", " ").replace("(", " ").replace(")", " "))
            assert_quoted(quoted, row(title, FIGURES[line])[: len(quoted)], f"{line}, {title}")
        else:
            assert numbers(cell.split("(")[0]) == inserted(title)


def _domain() -> list[str]:
    rows = [line for line in PAGE["Cells that differ from the default in one factor"].splitlines() if "/8 " in line]
    others = [line for line in rows if "(default)" not in line]
    assert all("│  8/8 │" in line for line in rows)
    return ["8", "8", str(len(others))]


def _pegs(way: str) -> list[str]:
    of_pegs = [title for title in PAGE if title.endswith(f", {way}")]
    assert len(of_pegs) == 9
    counts = {tuple(inserted(title)) for title in of_pegs}
    assert len(counts) == 1
    return list(counts.pop())


def _stuck(tries: int) -> list[str]:
    return inserted(f"Pegs that stick in their bore, freed in up to {tries} ways a push")


def _held(*touches: str) -> list[str]:
    """All six numbers together: the share held, after so many touches."""
    return [row("How often the 95 % region holds the truth", one)[10] for one in touches]


FAR, NEAR = "The same with a camera 6 mm off", "A cell that is not as drawn, refined over its own recordings"
LM, ROWS = "The paper's network, lm", "The paper's ten rows"
VISION = "What vision sees, and what it refuses"
ROUNDED = [0, 2, 4]  # of "RMS / p95" for three angles the RMS


def _rms(title: str, name: str) -> list[str]:
    return [row(title, name)[-6:][index] for index in ROUNDED]


# document, what it says (its groups are the figures), what the results hold
QUOTES: list[tuple[str, str, Callable[[], list[str]]]] = [
    (HOW_GOOD, r"bench domain --trials 8`: (\d+) of (\d+) inserted in each of the (\d+) cells", _domain),
    (HOW_GOOD, r"--peg NAME --trials 10`: (\d+) of (\d+) for each", lambda: _pegs("direct")),
    (HOW_GOOD, r"without a touch, (\d+) of (\d+) of each too", lambda: _pegs("swap")),
    (HOW_GOOD, r"(\d+) of (\d+), 7 of them without a touch", lambda: _stuck(3)),
    (HOW_GOOD, r"without a touch; (\d+) and", lambda: _stuck(0)[:1]),
    (
        HOW_GOOD,
        r"`: (\d+) of (\d+) sound picture pairs located, ([\d.]+) / [\d.]+ mm[a-z ]+, ([\d.]+) % of the truths",
        lambda: [*row(VISION, "sound")[1::-1], row(VISION, "sound")[3], row(VISION, "sound")[6]],
    ),
    (HOW_GOOD, r"region holds ([\d.]+), ([\d.]+) and ([\d.]+) %", lambda: _held("1", "2", "3")),
    (HOW_GOOD, r"tilts enter (\d) of 2, the spiral (\d),", lambda: ["2", compared(1, "spiral", 1)[0]]),
    (
        HOW_GOOD,
        r"fused (\d) of (\d) in ([\d.]+) s, peak (\d+) N",
        lambda: [*compared(2, "fused", 1), compared(2, "fused", 3)[0], compared(2, "fused", 8)[0]],
    ),
    (
        HOW_GOOD,
        r"([\d.]+) touches a trial before and (\d+) after",
        lambda: [row(FAR, "touches")[2], row(FAR, "touches")[5]],
    ),
    (
        HOW_GOOD,
        r"vision ([\d.]+) mm off before and ([\d.]+) after",
        lambda: [row(NEAR, "vision, mm")[0], row(NEAR, "vision, mm")[3]],
    ),
    (
        HOW_GOOD,
        r"T2 ([\d.]+) and ([\d.]+) mm \(p50\)",
        lambda: [row(NEAR, "final, mm")[0], row(NEAR, "final, mm")[3]],
    ),
    (HOW_GOOD, r"they reach ([\d.]+) / ([\d.]+) / ([\d.]+)° on poses", lambda: _rms(LM, "test")),
    (
        HOW_GOOD,
        r"against ([\d.]+) /\s+([\d.]+) / ([\d.]+)° for guessing the mean",
        lambda: _rms(LM, "test, guessing the mean"),
    ),
    (
        CLAIMS,
        r"test RMS (1[\d.]+) / ([\d.]+) / ([\d.]+)°; the mean 3.39",
        lambda: _rms(LM, "test"),
    ),
    (CLAIMS, r"eight networks \| RMS ([\d.]+) / ([\d.]+) / ([\d.]+)°", lambda: _rms(ROWS, "each by the nine others")),
    (CLAIMS, r"\| (\d) of (\d) inserted; with an earlier", lambda: compared(0, "paper", 1)),
    (CLAIMS, r"names (\d+) % right", lambda: row("The 26 contact states", "all on purpose")[1:2]),
    (STATES, r"on purpose \| (\d+) \| (\d+)%", lambda: row("The 26 contact states", "all on purpose")[:2]),
    (
        DATASETS,
        r"\| 1 mm, 3°; before any touch [^|]*\| 1 \| ([\d.]+) / ([\d.]+) mm, ([\d.]+) / ([\d.]+)°",
        lambda: _sequence("lateral mm", 0) + _sequence("rotation deg", 0),
    ),
]


def _sequence(what: str, touches: int) -> list[str]:
    line = next(
        line
        for line in PAGE["A network over touches beside the estimator"].splitlines()
        if line.split()[:4] == ["sequence", "network", *what.split()]
    )
    return numbers(line.replace("/", " "))[2 * touches : 2 * touches + 2]


@pytest.mark.parametrize(
    ("document", "said", "held"), QUOTES, ids=[f"{one[0]}-{number}" for number, one in enumerate(QUOTES)]
)
def test_a_quoted_figure_is_what_the_results_hold(document: str, said: str, held: Callable[[], list[str]]) -> None:
    text = " ".join(Path(document).read_text(encoding="utf-8").split())
    found = re.findall(said.replace(r"\s+", " "), text)
    assert len(found) == 1, f"{document} says this {len(found)} times: {said}"
    quoted = [found[0]] if isinstance(found[0], str) else list(found[0])
    assert_quoted(quoted, held(), document)


def test_poor_vision_is_as_poor_as_its_help_says() -> None:
    """The help of `bench compare` once said 1 mm where the setting is 2.5 mm."""
    said = CliRunner().invoke(app, ["bench", "compare", "--help"], env={"COLUMNS": "300"}).output
    degrees = POOR["rotation_rad"] * 57.2958
    assert f"off by {POOR['lateral_m'] * 1e3:g} mm and {degrees:.0f}°" in " ".join(said.split())
    assert f"off by {POOR['lateral_m'] * 1e3:g} mm and {degrees:.0f}° an axis" in Path("docs/benches.md").read_text(
        "utf-8"
    )


def test_the_docs_name_all_figures_that_differ_from_run_to_run() -> None:
    """A seed repeats a trial to the last bit but for what rests on times on the wall."""
    said = Path("docs/benches.md").read_text(encoding="utf-8").split("## Cells side by side")[0]
    assert set(re.findall(r"`(\w+)`", said)) >= set(WALL_FIGURES)
