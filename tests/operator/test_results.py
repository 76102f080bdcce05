"""`crosspih results`: commands declared once, run when their result is missing, and the page that they make."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from crosspih_common.errors import ConfigError
from crosspih_common.modules import module_command
from services.operator.__main__ import app
from services.operator.results.cli import entries_named
from services.operator.results.page import duration, make_page
from services.operator.results.plan import Entry, arguments, load_plan
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
    entries = [Entry(name=each, title="", command="crosspih x") for each in ("one", "one-more", "p-x", "p-y")]
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
        code="c0de",
        cores=2,
        status=1,
        elapsed_s=7300.0,
        text="argv[0]=\na table\nargv[0]=\n",
    )
    page = make_page(entries, {"two": printed}, "docs/results", "other")
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
