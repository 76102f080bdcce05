"""The report of a synthetic assembly: self-contained, complete, and honest about what is missing."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from typer import Typer
from typer.testing import CliRunner

from services.operator.report import make_report
from services.operator.report.command import report
from services.operator.report.figure import draw_figure
from services.operator.report.page import number
from tests.recorder.synthetic import SyntheticRecording, result, write_assembly

LIMIT_BYTES = 2_000_000
VOID = {"meta", "link", "img", "br", "hr", "input", "area", "base", "col"}


class Balance(HTMLParser):
    """Every element that opens is closed, in order."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open[-1] == tag, (tag, self.open[-5:], self.getpos())
        self.open.pop()


def page_of(mcap: Path) -> str:
    page = mcap.with_suffix(".html")
    make_report(mcap, page)
    assert page.stat().st_size < LIMIT_BYTES
    text = page.read_text(encoding="utf-8")
    # nothing is fetched from anywhere
    assert "//" not in re.sub(r"data:image/jpeg;base64,[A-Za-z0-9+/=]+", "", text)
    assert not re.search(r"<(script|link|iframe|object)\b|@import|url\((?!#)", text)
    balance = Balance()
    balance.feed(text)
    assert balance.open == []
    return text


def test_a_whole_assembly(tmp_path: Path) -> None:
    write_assembly(tmp_path / "a.mcap")
    text = page_of(tmp_path / "a.mcap")
    assert '<h1 class="good">Inserted</h1>' in text
    assert "Missing from this recording" not in text
    for shown in ("seed 42", "12.7 <small>s", "15.3 <small>N", "0.036 <small>mm", "1-2-2", "arm 2 on the rim", "87 %"):
        assert shown in text, shown
    assert text.count("data:image/jpeg;base64,") == 2
    assert text.count("<svg") == 1 and "currentColor" in text
    assert "0.60 mm, 0.34°" in text and "0.15 mm, 0.09°" in text  # each estimate against the truth
    assert "−6.0" in text and "touch 2 from the left" in text
    assert "&lt;b&gt;rather&lt;/b&gt; dark" in text  # what services say is text, never markup


def test_the_same_recording_gives_the_same_page(tmp_path: Path) -> None:
    write_assembly(tmp_path / "a.mcap")
    assert page_of(tmp_path / "a.mcap") == page_of(tmp_path / "a.mcap")


def test_a_failure_is_named(tmp_path: Path) -> None:
    write_assembly(tmp_path / "f.mcap", inserted=False)
    text = page_of(tmp_path / "f.mcap")
    assert "Not inserted: not converged" in text
    assert "5 pushes did not enter The peg was backed off." in text


def test_a_torn_recording_says_so(tmp_path: Path) -> None:
    write_assembly(tmp_path / "t.mcap", finish=False)
    whole = (tmp_path / "t.mcap").read_bytes()
    (tmp_path / "t.mcap").write_bytes(whole[:-7])
    text = page_of(tmp_path / "t.mcap")
    assert "No result in this recording" in text
    assert "The end of t.mcap" in text and "The result:" in text


def test_an_empty_recording_lists_all_that_is_missing(tmp_path: Path) -> None:
    SyntheticRecording(tmp_path / "e.mcap").finish()
    text = page_of(tmp_path / "e.mcap")
    for missing in ("The result:", "The truth:", "The contact wrench:", "The phases:", "The annotated pictures:"):
        assert missing in text
    assert "<svg" not in text


def test_a_result_alone_is_shown_without_errors(tmp_path: Path) -> None:
    from crosspih_common.keys import ASSEMBLE

    recording = SyntheticRecording(tmp_path / "r.mcap")
    recording.add(ASSEMBLE.reply_echo, result(True))
    recording.finish()
    text = page_of(tmp_path / "r.mcap")
    assert "Errors are against the simulator" in text and '<h1 class="good">Inserted</h1>' in text


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


@pytest.mark.parametrize(
    ("value", "text"), [(-0.001, "0.00"), (-1.5, "−1.50"), (None, "–"), (float("nan"), "–"), (2.0, "2.00")]
)
def test_numbers_are_for_people(value: float | None, text: str) -> None:
    assert number(value) == text


def test_the_figure_is_drawn_without_a_display(tmp_path: Path) -> None:
    from crosspih_common.recording import read_recording
    from services.operator.report.content import collect

    write_assembly(tmp_path / "g.mcap")
    figure = draw_figure(collect(read_recording(tmp_path / "g.mcap")))
    assert figure is not None and len(figure.axes) == 3
