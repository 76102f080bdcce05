"""Contact point, section, words, playhead: small cores of the page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from crosspih_common.config import Workcell
from crosspih_common.geometry import wrench_of_force_at_point
from crosspih_common.messages import ContactState, Event, ServiceState, ServiceStatus, Severity
from services.force_torque.contact_table import STATES
from services.viewer import words
from services.viewer.contact_point import contact_point
from services.viewer.playhead import Playhead
from services.viewer.section_picture import arms_of, section_svg
from services.viewer.timeline import SceneMoment
from services.viewer.view_points import view_points

PEG = Workcell().peg.shape()


@pytest.mark.parametrize(
    ("point", "force"),
    [
        ((0.009, 0.02, 0.04), (-8.0, 0.0, -1.0)),
        ((0.0, 0.0, PEG.tip_m), (0.5, 0.0, -9.0)),
        ((-0.027, 0.004, 0.03), (5.0, 1.0, 0.0)),
    ],
)
def test_a_force_that_presses_on_the_peg_is_found_where_it_presses(
    point: tuple[float, ...], force: tuple[float, ...]
) -> None:
    found = contact_point(wrench_of_force_at_point(np.array(force), np.array(point)), PEG)
    assert found is not None and found == pytest.approx(point, abs=0.0015)


def test_no_point_is_made_of_too_small_a_force_or_of_one_that_misses_the_peg() -> None:
    assert contact_point([0.1, 0.0, -0.2, 0.0, 0.0, 0.0], PEG) is None
    assert contact_point(wrench_of_force_at_point(np.array([0.0, 0.0, -9.0]), np.array([0.2, 0.0, 0.0])), PEG) is None


def test_the_lit_arms_are_those_of_the_papers_tables() -> None:
    for row in STATES:
        state = ContactState(case=row.name, count=row.count, sense=row.sense, n_z0=0.3, confidence=0.9)
        assert arms_of(state) == row.arms
        assert section_svg(PEG, state, None).count("<polygon") == 1 + row.count
    assert arms_of(None) == arms_of(ContactState(case=None, n_z0=0.0, confidence=0.0)) == ()


def test_the_arrow_points_as_the_force_does_and_stays_away_without_one() -> None:
    pushed = section_svg(PEG, None, np.array([9.0, 0.0, -1.0, 0.0, 0.0, 0.0]))
    assert pushed.count("<polygon") == 2 and "<line" in pushed
    assert section_svg(PEG, None, np.array([0.1, 0.0, -9.0, 0.0, 0.0, 0.0])).count("<polygon") == 1


def test_what_comes_from_the_bus_is_text_and_no_html() -> None:
    evil = "<img src=x onerror=alert(1)>"
    status = ServiceStatus(
        stamp_ns=0, service=evil, state=ServiceState.READY, pid=1, uptime_s=1.0, reason=evil, last_error=evil
    )
    event = Event(stamp_ns=0, service="vision", severity=Severity.ERROR, code="x", text=evil)
    moment = SceneMoment(stamp_ns=0, trial_ns=0, services=(status,), events=(event,))
    assert "<img" not in words.services(moment) + words.warnings(moment)
    assert "gone" in words.services(moment, frozenset()) and "ready" in words.services(moment, frozenset([evil]))


def test_the_playhead_runs_steps_and_ends() -> None:
    head = Playhead(0.0, 10.0, [2.0, 5.0, 99.0])
    head.play()
    head.speed(2.0)
    assert head.advance(1.5) == 3.0
    head.step(forwards=True)
    assert (head.now_s, head.playing, head.advance(1.0)) == (5.0, False, 5.0)
    head.step(forwards=False)
    assert head.now_s == 2.0
    head.seek(99.0)
    assert head.now_s == 10.0
    head.play()  # from the start again
    assert head.now_s == 0.0 and head.advance(20.0) == 10.0 and not head.playing


def test_recordings_of_one_name_are_told_apart() -> None:
    pytest.importorskip("viser", reason="the page wants viser: pip install 'crosspih[viewer]'")
    from services.viewer.playback import names_of

    assert names_of([Path("a/x.mcap"), Path("a/y.mcap")]) == ["x", "y"]
    assert names_of([Path("a/x.mcap"), Path("b/x.mcap")]) == ["A x", "B x"]


def test_every_view_point_sees_what_it_looks_at_from_outside_the_plate() -> None:
    workcell = Workcell()
    hole = workcell.hole_prior.pose_base_hole()
    for name, view in view_points(workcell).items():
        eye = hole.inverse().apply(view.eye_m)
        assert eye[2] < 0.06 and np.linalg.norm(view.eye_m - view.target_m) > 0.2, name
