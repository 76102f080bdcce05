"""The report of a synthetic assembly: one file, complete, at one with itself, and honest about what is missing."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer import Typer
from typer.testing import CliRunner

from crosspih_common.keys import ASSEMBLE
from crosspih_common.recording import read_recording
from services.operator.report import make_comparison, make_report
from services.operator.report.charts import chart_data
from services.operator.report.command import report
from services.operator.report.model import Facts, facts_of
from services.operator.report.model.forces import Trace, free_spans, peak_of
from services.operator.report.numbers import number
from services.operator.report.thinning import thinned
from services.operator.report.tiles import tiles
from tests.recorder.synthetic import SyntheticRecording, result, write_assembly

LIMIT_BYTES = 3_000_000
VOID = {"meta", "link", "img", "br", "hr", "input", "area", "base", "col"}


@dataclass
class Page(HTMLParser):
    """What a browser would read: every element that opens is closed in order, the words of tiles and tables apart."""

    text: str
    open: list[str] = field(default_factory=list)
    headings: list[int] = field(default_factory=list)
    tables: list[str] = field(default_factory=list)
    images_without_words: int = 0

    def __post_init__(self) -> None:
        super().__init__()
        self.feed(self.text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag == "img" and not given.get("alt"):
            self.images_without_words += 1
        assert not (given.get("src") or "data:").startswith(("http", "//")), given
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open[-1] == tag, (tag, self.open[-5:], self.getpos())
        self.open.pop()

    def handle_data(self, data: str) -> None:
        if "table" in self.open:
            self.tables.append(data)

    def chart_data(self) -> dict[str, Any]:
        found = re.search(r'<script type="application/json" id="report-data">(.*?)</script>', self.text)
        assert found is not None
        return json.loads(found[1])  # type: ignore[no-any-return]


def page_of(mcap: Path) -> Page:
    html = mcap.with_suffix(".html")
    make_report(mcap, html)
    return read_page(html)


def read_page(html: Path) -> Page:
    assert html.stat().st_size < LIMIT_BYTES
    page = Page(html.read_text(encoding="utf-8"))
    # nothing is fetched from anywhere, and the browser is told so
    assert "default-src &#39;none&#39;" in page.text
    assert not re.search(r"<(link (?!rel=\"icon\")|iframe|object)|@import", page.text)
    assert page.images_without_words == 0
    assert page.headings[0] == 1 and all(b - a <= 1 for a, b in pairwise(page.headings))
    return page


def decoded(chart: dict[str, Any], which: int, tick: float) -> tuple[np.ndarray, np.ndarray]:
    """(n,) s and (n, columns) of a chart's set, as the page's script reads them."""
    chosen = chart["sets"][which]
    return np.cumsum(chosen["t"]) * tick, np.array(chosen["y"]).T * chart["step"]


def agrees(facts: Facts, page: Page) -> None:
    """Every number of a tile stands in a table too, and the peaks are in the chart's data."""
    tables = " ".join(" ".join(page.tables).split())
    for tile in tiles(facts):
        counts = tile.name in ("touches", "corrections")
        for quantity in () if counts else (tile.value, *tile.also):
            shown = {quantity.text, number(quantity.value, 2), number(quantity.value, 3)}
            assert any(text in tables for text in shown), (tile.name, quantity, tables)
    data, forces = page.chart_data(), facts.forces
    free = np.array(data["free"]).reshape(-1, 2)
    for chart in data["charts"][:2]:
        kind = "force_n" if chart["id"] == "force" else "moment_nm"
        peaks = [peak for peak in (forces.contact_unfiltered, forces.contact_filtered) if peak is not None]
        assert len(peaks) == len(chart["sets"])
        for which, peak in enumerate(peaks):
            time_s, columns = decoded(chart, which, data["tick"])
            touching = ~((time_s[:, None] >= free[:, 0] - 1e-4) & (time_s[:, None] <= free[:, 1] + 1e-4)).any(axis=1)
            value, at_s = getattr(peak, kind), getattr(peak, kind.split("_")[0] + "_at_s")
            assert columns[touching, 3].max() == pytest.approx(value, abs=chart["step"])
            nearest = int(np.argmin(np.abs(time_s - at_s)))
            assert time_s[nearest] == pytest.approx(at_s, abs=1e-3)
            assert columns[nearest, 3] == pytest.approx(value, abs=chart["step"])
    touches = [touch["label"] for touch in data["touches"]]
    assert len([label for label in touches if not label.startswith("p")]) == len(facts.touches)
    assert len([label for label in touches if label.startswith("p")]) == len(facts.presses)


CASES: dict[str, dict[str, Any]] = {
    "filtered alone": {},
    "with the sensor's samples": {"push_n": 17.5, "presses": 3},
    "failed": {"inserted": False, "push_n": 6.25},
}


@pytest.mark.parametrize("case", CASES)
def test_tiles_charts_and_tables_tell_the_same(tmp_path: Path, case: str) -> None:
    write_assembly(tmp_path / "a.mcap", **CASES[case])
    facts = facts_of(read_recording(tmp_path / "a.mcap"))
    agrees(facts, page_of(tmp_path / "a.mcap"))
    push_n, presses = CASES[case].get("push_n"), CASES[case].get("presses", 0)
    assert (len(facts.touches), len(facts.presses)) == (2, presses)
    if push_n is not None:
        # known answer: weight and bias are taken off, and the push alone is left
        assert facts.forces.contact_unfiltered is not None
        assert facts.forces.contact_unfiltered.force_n == pytest.approx(push_n, rel=2e-3)
        assert facts.forces.contact_unfiltered.force_at_s == pytest.approx(10.5, abs=0.1)
        # before the peg is at the hole nothing can be touched, and nothing is felt
        assert facts.forces.free_spans[0] == pytest.approx((0.0, 8.475), abs=0.03)
        assert facts.forces.inertia is not None and facts.forces.inertia.force_n < 0.1


def test_recorded_assemblies_agree_with_themselves() -> None:
    """The sample of docs/: a fused assembly that touched, as it was recorded."""
    sample = Path(__file__).parents[2] / "docs" / "sample" / "assembly.mcap"
    facts = facts_of(read_recording(sample))
    assert facts.checks and all(check.agrees for check in facts.checks), facts.checks
    assert facts.forces.unfiltered is not None and facts.forces.unexplained_n is not None
    # what is felt in free air is the tool's inertia, but for the sensor's noise of 0.1 N an axis
    assert facts.forces.inertia is not None and facts.forces.unexplained_n < 0.6
    spent = sum(times.cell_s for times in facts.times)
    assert spent == pytest.approx(facts.end_s - facts.spans[0].start_s)
    data = chart_data(facts)
    force = next(chart for chart in data["charts"] if chart["id"] == "force")
    assert max(force["sets"][0]["y"][3]) * force["step"] == pytest.approx(
        max(facts.forces.unfiltered.force_n), abs=force["step"]
    )


def test_a_whole_assembly(tmp_path: Path) -> None:
    write_assembly(tmp_path / "a.mcap", presses=4)
    page = page_of(tmp_path / "a.mcap")
    assert '<h1 class="good">Inserted</h1>' in page.text
    assert "The sensor&#39;s own samples" in page.text  # which this recording has not
    for shown in ("seed 42", "12.71 <small>s", "0.036 <small>mm", "1-2-2", "arm 2 on the rim", "87 %", "4 presses"):
        assert shown in page.text, shown
    assert page.text.count("data:image/webp;base64,") == 2
    assert "0.600 mm, 0.34°" in page.text and "0.150 mm, 0.09°" in page.text  # each estimate against the truth
    assert "−6.00" in page.text and "touch 2 from the left" in page.text
    assert "&lt;b&gt;rather&lt;/b&gt; dark" in page.text  # what services say is text, never markup
    # the result says 15.31 N, of which no sample is here: told as what it is, and that it does not agree is not hidden
    assert "two cameras tell where the hole is" in page.text


def test_what_did_not_happen_is_not_told(tmp_path: Path) -> None:
    """A star felt for by force alone: no cross, no cameras."""
    write_assembly(tmp_path / "s.mcap", cell_yaml="cell:\n  peg: {outline: star}\n", strategy="force_alone", saw=False)
    page = page_of(tmp_path / "s.mcap")
    assert "star-shaped peg" in page.text and "cross-shaped" not in page.text
    assert "The cameras were not asked" in page.text and "cameras tell" not in page.text
    assert "vision&#39;s error" not in page.text


def test_a_strategy_of_ones_own_is_named(tmp_path: Path) -> None:
    write_assembly(tmp_path / "o.mcap", strategy="my_lab.mine:Wiggle")
    assert "Strategy my_lab.mine:Wiggle: two cameras tell" in page_of(tmp_path / "o.mcap").text


def test_the_same_recording_gives_the_same_page(tmp_path: Path) -> None:
    write_assembly(tmp_path / "a.mcap")
    assert page_of(tmp_path / "a.mcap").text == page_of(tmp_path / "a.mcap").text


def test_a_failure_is_named(tmp_path: Path) -> None:
    write_assembly(tmp_path / "f.mcap", inserted=False)
    page = page_of(tmp_path / "f.mcap")
    assert "Not inserted: not converged" in page.text
    assert "5 pushes did not enter. The peg was backed off." in page.text


def test_counts_that_differ_are_shown_as_differing(tmp_path: Path) -> None:
    write_assembly(tmp_path / "d.mcap", told_touches=5)
    facts = facts_of(read_recording(tmp_path / "d.mcap"))
    wrong = [check for check in facts.checks if not check.agrees]
    assert ("touches", 5, 2) in [(check.what, check.one.value, check.other.value) for check in wrong]
    assert '<tr class="differs"><th scope="row">touches' in page_of(tmp_path / "d.mcap").text


def test_a_torn_recording_says_so(tmp_path: Path) -> None:
    write_assembly(tmp_path / "t.mcap", finish=False)
    whole = (tmp_path / "t.mcap").read_bytes()
    (tmp_path / "t.mcap").write_bytes(whole[:-7])
    page = page_of(tmp_path / "t.mcap")
    assert "No result in this recording" in page.text
    assert "The end of t.mcap" in page.text and "The result:" in page.text


def test_an_empty_recording_lists_all_that_is_missing(tmp_path: Path) -> None:
    SyntheticRecording(tmp_path / "e.mcap").finish()
    page = page_of(tmp_path / "e.mcap")
    for missing in ("The result:", "The truth:", "The contact wrench:", "The phases:", "The annotated pictures:"):
        assert missing in page.text
    assert page.chart_data()["charts"] == []


def test_a_result_alone_is_shown_without_errors(tmp_path: Path) -> None:
    recording = SyntheticRecording(tmp_path / "r.mcap")
    recording.add(ASSEMBLE.reply_echo, result(True))
    recording.finish()
    page = page_of(tmp_path / "r.mcap")
    assert "Errors are against the simulator" in page.text and '<h1 class="good">Inserted</h1>' in page.text


def test_two_side_by_side(tmp_path: Path) -> None:
    write_assembly(tmp_path / "a.mcap", push_n=17.5)
    write_assembly(tmp_path / "b.mcap", push_n=6.25, presses=2, cell_yaml="cell:\n  insertion_depth_m: 0.012\n")
    make_comparison(tmp_path / "a.mcap", tmp_path / "b.mcap", tmp_path / "ab.html")
    page = read_page(tmp_path / "ab.html")
    told = " ".join(" ".join(page.tables).split())
    assert "peak contact force 17.50 6.25 −11.25 N" in told
    assert "cell.insertion_depth_m 0.015 0.012" in told  # marked as differing; what is the same is told once
    data = page.chart_data()
    assert data["first"] == "pushing" and data["aligned"][0]["pushing"] == data["aligned"][1]["pushing"] == 3.1
    assert [chart["id"] for chart in data["charts"]] == ["force", "moment", "depth"]


def test_the_command(tmp_path: Path) -> None:
    app = Typer()
    app.command()(report)
    write_assembly(tmp_path / "c.mcap")
    done = CliRunner().invoke(app, [str(tmp_path / "c.mcap"), "-o", str(tmp_path / "sub" / "page.html")])
    assert done.exit_code == 0 and (tmp_path / "sub" / "page.html").exists()
    (tmp_path / "no.mcap").write_text("no recording")
    failed = CliRunner().invoke(app, [str(tmp_path / "no.mcap")])
    assert failed.exit_code == 1 and "is no MCAP file" in failed.output
    assert CliRunner().invoke(app, [str(tmp_path / "absent.mcap")]).exit_code == 1
    assert CliRunner().invoke(app, [str(tmp_path / "c.mcap")] * 3).exit_code == 2


@pytest.mark.parametrize(
    ("value", "text"), [(-0.001, "0.00"), (-1.5, "−1.50"), (None, "–"), (float("nan"), "–"), (2.0, "2.00")]
)
def test_numbers_are_for_people(value: float | None, text: str) -> None:
    assert number(value) == text


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 6000), columns=st.integers(1, 5))
def test_thinning_keeps_every_peak(seed: int, rows: int, columns: int) -> None:
    values = np.random.default_rng(seed).normal(size=(rows, columns))
    keep = thinned(values, buckets=50)
    assert keep[0] == 0 and keep[-1] == rows - 1 and (np.diff(keep) > 0).all()
    assert (values[keep].max(axis=0) == values.max(axis=0)).all()
    assert (values[keep].min(axis=0) == values.min(axis=0)).all()


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.0, 1.0))
def test_a_peak_is_in_free_air_or_it_is_not(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    trace = Trace(np.linspace(0.0, 2.0, 200), rng.normal(size=(200, 6)), rng.random(200) < share, 100.0)
    peaks = [peak for peak in (peak_of(trace, free=True), peak_of(trace, free=False)) if peak is not None]
    assert max(peak.force_n for peak in peaks) == trace.force_n.max()
    assert max(peak.moment_nm for peak in peaks) == trace.moment_nm.max()


def test_without_encoders_and_motions_nothing_counts_as_free_air() -> None:
    from crosspih_common.geometry import Pose

    assert free_spans(None, [], Pose.identity(), 10.0) == ()
