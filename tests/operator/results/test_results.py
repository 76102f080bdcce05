"""`crosspih results`: commands declared once, run when their result is missing, and the page that they make."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from crosspih_common.errors import ConfigError
from crosspih_common.modules import module_command
from services.operator.cli.commands import app
from services.operator.results.command import entries_named
from services.operator.results.page import SectionCounts, duration, make_page, when
from services.operator.results.plan import PlannedSection, arguments, load_plan
from services.operator.results.printed import Printed

PLAN = """
- {name: one, title: The first, says: Look., command: python -m platform --terse, in_cells: false, has_json: false}
- {name: two, title: The second, command: "python -m no_such_module {out}/two.png", in_cells: false, has_json: false}
"""


def test_the_shipped_plan_can_be_read() -> None:
    entries = load_plan()
    assert {"assembly", "domain", "scaling"} <= {entry.name for entry in entries}


@pytest.mark.parametrize(
    "text, said",
    [
        ("a: b", "list of entries"),
        ("- {name: a}", "entry 1: title"),
        ("- {name: a, title: A, command: rm -r x}", "crosspih or python -m"),
        ("- {name: a, title: A, command: crosspih x}\n- {name: a, title: A, command: crosspih x}", "taken"),
    ],
)
def test_a_plan_that_is_wrong_is_refused_by_name(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=said):
        load_plan(path)


def test_an_entry_stands_for_all_combinations(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(
        '- {name: p, title: "{a} of {b}", command: "crosspih x --a {a} --b {b} {out}/x.png", '
        'each: {a: [x, Y Z], b: ["1"]}}',
        encoding="utf-8",
    )
    entries = load_plan(path)
    assert [(entry.name, entry.title) for entry in entries] == [("p-x-1", "x of 1"), ("p-y-z-1", "Y Z of 1")]
    assert entries[0].shown("docs/results") == "crosspih x --a x --b 1 docs/results/x.png"


@pytest.mark.parametrize(
    "name, found", [("p", ["p-x", "p-y"]), ("p-x", ["p-x"]), ("one", ["one"]), ("one-more", ["one-more"])]
)
def test_a_name_or_how_names_begin_is_enough(name: str, found: list[str]) -> None:
    entries = [PlannedSection(name=each, title="", command="crosspih x") for each in ("one", "one-more", "p-x", "p-y")]
    assert [entry.name for entry in entries_named(entries, [name])] == found


def test_commands_run_with_this_interpreter() -> None:
    assert arguments("crosspih bench domain") == module_command("services.operator", "bench", "domain")
    assert arguments("python -m a 'b c'")[1:] == ["-m", "a", "b c"]


def test_the_page_holds_commands_what_they_said_and_pictures(tmp_path: Path) -> None:
    path = tmp_path / "plan.yaml"
    path.write_text(PLAN, encoding="utf-8")
    entries = load_plan(path)
    command = entries[1].shown("docs/results")
    printed = Printed(
        name="two",
        command=command,
        code="c0de" * 4,
        cores=2,
        status=1,
        elapsed_s=7300.0,
        text="argv[0]=\na table\nargv[0]=\n",
    )
    page, counts = make_page(entries, {"two": printed}, "docs/results", "other")
    assert counts == SectionCounts(this=0, other=1, missing=1)
    assert "Not run yet." in page and "Look." in page
    assert "```text\na table\n```" in page and "![The second](results/two.png)" in page
    assert "ended with status 1" in page and "changed since" in page and duration(7300.0) in page


def test_a_known_result_is_not_made_again_and_a_failure_is_told(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    options = ["--plan", f"{tmp_path}/plan.yaml", "--page", f"{tmp_path}/results.md", "--kept", f"{tmp_path}/kept"]
    first = CliRunner().invoke(app, ["results", *options])
    assert first.exit_code == 1 and "failed: two" in first.output
    page = (tmp_path / "results.md").read_text(encoding="utf-8")
    assert "ended with status 1" in page
    again = CliRunner().invoke(app, ["results", "one", *options])
    assert again.exit_code == 0 and "one: known" in again.output
    assert (tmp_path / "results.md").read_text(encoding="utf-8") == page
    unknown = CliRunner().invoke(app, ["results", "three", *options])
    assert unknown.exit_code == 1 and "three: no such result" in unknown.output


def test_a_fresh_clone_keeps_the_page_that_came_with_it(tmp_path: Path) -> None:
    """What the page was printed from does not come with the code: it must not become 'Not run yet'."""
    entries = load_plan()
    before = Path("docs/results.md").read_text(encoding="utf-8")
    after, counts = make_page(entries, {}, "docs/results", "0" * 16, before)
    assert counts.missing == before.count("Not run yet.") and counts.this == 0
    for section in before.split("\n## ")[1:]:
        table = section.split("```text\n")[1].split("\n```")[0]
        assert table in after
    assert after.count("the code has changed since") == counts.other
    once_more, _ = make_page(entries, {}, "docs/results", "0" * 16, after)
    assert once_more == after
    other_plan = [entry.model_copy(update={"command": "crosspih bench nothing"}) for entry in entries[:1]]
    assert "the command is another one since" in make_page(other_plan, {}, "docs/results", "0" * 16, before)[0]


@pytest.mark.parametrize(
    ("taken", "made", "said"),
    [
        (0, 400, "Measured in 60 s on 2 cores, 2026-12-01"),
        (
            400,
            0,
            "Printed from the store in 60 s; its 400 results were measured before, 2026-11-29 to 2026-11-30, in ",
        ),
        (
            300,
            100,
            "Measured: 100 results in 60 s on 2 cores, 2026-12-01; 300 results were measured ",
        ),
    ],
)
def test_the_time_of_a_reprint_is_not_given_for_that_of_the_measurement(taken: int, made: int, said: str) -> None:
    times = ("2026-11-29T10:00:00+00:00", "2026-11-30T10:00:00+00:00")
    printed = Printed(
        name="a", command="", code="", cores=2, status=0, elapsed_s=60.0, text="", at="2026-12-01T10:00:00+00:00",
        taken=taken, made=made, taken_s=1620.0, first=times[0], last=times[1],
    )  # fmt: skip
    assert when(printed).startswith(said)


def test_what_a_command_took_over_reaches_the_page(tmp_path: Path) -> None:
    """The estimator's coverage twice, of one trial: measured, then printed from its store."""
    plan, out = tmp_path / "plan.yaml", tmp_path / "p.jsonl"
    command = f"python -m services.inference.estimator --trials 1 --touches 1 --out {out}"
    plan.write_text(f"- {{name: a, title: A, command: {command!r}, in_cells: false, has_json: false}}")
    options = ["--plan", str(plan), "--page", f"{tmp_path}/results.md", "--kept", f"{tmp_path}/kept", "--again"]
    for said in ("Measured in", "Printed from the store in"):
        done = CliRunner().invoke(app, ["results", *options])
        assert done.exit_code == 0 and "1 of 1 sections are by code" in " ".join(done.output.split()), done.output
        assert said in (tmp_path / "results.md").read_text(encoding="utf-8")
