"""Pictures drawn from a recording: where what is drawn lies, and the moving picture of an assembly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from crosspih_common.config import Workcell
from crosspih_common.recording import read_recording
from services.operator.cli.commands import app
from services.operator.recordings.animating.timing import frame_times
from services.operator.report.model import facts_of
from services.operator.scene3d import Viewpoint, can_draw, draw
from services.operator.scene3d.bodies import Bodies, cut_normal
from services.operator.scene3d.meshes import capsule, convex
from tests.recorder.synthetic import SyntheticRecording, write_assembly

pytestmark = pytest.mark.skipif(not can_draw(), reason="OpenCV 5 draws in space, an older one does not")


def test_a_point_is_drawn_where_it_is_reckoned_to_be() -> None:
    """Not upside down, and not left for right: a small ball beside and above the middle."""
    view, centre = Viewpoint((0.0, -1.0, 0.2), (0.0, 0.0, 0.2)), np.array([0.1, 0.05, 0.31])
    ball = capsule(centre, centre, 0.01, (1.0, 0.0, 0.0))
    picture = draw(ball, view, (300, 200), (0.0, 0.0, 0.0), np.array([0.0, -1.0, 1.0])).astype(float)
    rows, columns = np.nonzero(picture[..., 0] > 60.0)
    found = np.array([columns.mean() + 0.5, rows.mean() + 0.5])
    assert found == pytest.approx(view.pixels(centre[None], (300, 200))[0], abs=1.0)
    assert found[0] > 150.0 and found[1] < 100.0


def test_a_body_is_cut_where_it_is_said() -> None:
    cube = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    left = convex(cube, (1.0, 1.0, 1.0), (np.array([1.0, 0.0, 0.0]), 0.25, (0.0, 0.0, 1.0)))
    assert left is not None
    corners = left.corners_m.reshape(-1, 3)
    assert corners[:, 0].max() == pytest.approx(0.25) and corners[:, 0].min() == pytest.approx(-1.0)
    section = left.corners_m[(left.colours == (0.0, 0.0, 1.0)).all(axis=1)]
    areas = np.linalg.norm(np.cross(section[:, 1] - section[:, 0], section[:, 2] - section[:, 0]), axis=1) / 2.0
    assert areas.sum() == pytest.approx(4.0)
    assert convex(cube, (1.0, 1.0, 1.0), (np.array([1.0, 0.0, 0.0]), -1.5, (0.0, 0.0, 1.0))) is None


def test_half_of_the_plate_is_taken_away() -> None:
    cell = Workcell()
    bodies, normal = Bodies.of(cell), cut_normal(cell)
    assert (bodies.plate.corners_m @ normal).max() == pytest.approx(cell.hole.shape(cell.peg.shape()).plate_half_size_m)
    assert (bodies.plate_cut.corners_m @ normal).max() == pytest.approx(0.0, abs=1e-9)
    # the peg as drawn ends where the drawing ends it
    assert bodies.peg.corners_m[..., 2].max() == pytest.approx(cell.peg.shape().tip_m)


def test_a_moving_picture(tmp_path: Path) -> None:
    write_assembly(tmp_path / "a.mcap", push_n=17.5, presses=2)
    facts = facts_of(read_recording(tmp_path / "a.mcap"))
    times = [frame.time_s for frame in frame_times(facts, 14.0, 10.0) if not frame.looking]
    assert times == sorted(times) and times[-1] == pytest.approx(facts.end_s)
    pressed = sum(1 for time_s in times if 9.2 <= time_s <= 11.8)
    before = sum(1 for time_s in times if 2.0 <= time_s <= 4.6)
    assert pressed > 3 * before  # what touches is shown slowly, free air quickly

    command, made = ["recording", "animate"], tmp_path / "a.gif"
    done = CliRunner().invoke(
        app, [*command, str(tmp_path / "a.mcap"), "-o", str(made), "--seconds", "4", "--fps", "2"]
    )
    assert done.exit_code == 0 and "8 frames" in done.output
    with Image.open(made) as film:
        assert film.size == (880, 540) and 2 <= getattr(film, "n_frames", 1) <= 8
    SyntheticRecording(tmp_path / "e.mcap").finish()
    for file, out, said in (("a.mcap", "a.avi", ".webp"), ("e.mcap", "e.gif", "no encoders"), ("no.mcap", "n.gif", "")):
        failed = CliRunner().invoke(app, [*command, str(tmp_path / file), "-o", str(tmp_path / out)])
        assert failed.exit_code == 1 and said in failed.output
        assert not (tmp_path / out).exists()
