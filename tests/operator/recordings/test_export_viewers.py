"""Recordings for viewers and learners: topics added to one that has none, kept by cuts; a LeRobot dataset."""

from __future__ import annotations

import json
from pathlib import Path

import av
import numpy as np
import pyarrow.parquet
import pytest
from typer.testing import CliRunner

from crosspih_common.config import Workcell
from crosspih_common.keys import IMAGE_LEFT, IMAGE_RIGHT, JOINT_STATE, TRUTH
from crosspih_common.messages import JointState
from crosspih_common.recording import read_recording
from crosspih_common.recording.viewers import URDF
from services.operator.cli.commands import app
from services.operator.recordings.export.foxglove import add_topics
from services.operator.recordings.export.lerobot.episodes import PHASES
from services.operator.recordings.export.shown import EVERY
from services.operator.recordings.looking import findings
from services.operator.recordings.making import cut, merge
from tests.recorder.synthetic import START_NS, SyntheticRecording, at, seen, write_assembly

FPS = 4


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An assembly as a recorder without topics for viewers writes it."""
    folder = tmp_path_factory.mktemp("recorded")
    path, assembly, pictures = (folder / f"{name}.mcap" for name in ("a", "assembly", "pictures"))
    write_assembly(assembly)
    recording = SyntheticRecording(pictures)
    for topic, frame in ((IMAGE_LEFT, "camera_left"), (IMAGE_RIGHT, "camera_right")):
        recording.add(topic, seen(frame, 0))
    home = Workcell().home_joints_rad
    for step in range(0, 1240, 2):
        angles = (home[0] + 1e-3 * step, *home[1:])
        recording.add(JOINT_STATE, JointState(stamp_ns=at(step * 0.01), joints_rad=angles, speeds_rad_s=(0.1,) * 6))
    recording.finish()
    merge([assembly, pictures], path)
    return path


@pytest.fixture(scope="module")
def shown(recorded: Path) -> Path:
    path = recorded.with_name("shown.mcap")
    counts = add_topics(read_recording(recorded, EVERY), path)
    assert counts["/foxglove/transforms"] > 100 and counts["/foxglove/log"] >= 10
    return path


def test_what_is_added_changes_nothing_that_our_own_readers_see(recorded: Path, shown: Path) -> None:
    before, after = read_recording(recorded), read_recording(shown)
    assert after.samples == before.samples and after.schemas == before.schemas
    assert after.shown.total() > 1000 and not before.shown
    assert [one.name for one in after.parts[0].attachments if one.name == URDF] == [URDF]
    assert {finding.what for finding in findings(shown)[1]} == {finding.what for finding in findings(recorded)[1]}


def test_topics_are_made_anew_and_not_twice(shown: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.mcap"
    counts = add_topics(read_recording(shown, EVERY), again)
    assert dict(read_recording(again).shown) == dict(counts) == dict(read_recording(shown).shown)


def test_a_cut_keeps_what_stands_in_the_scene_and_a_merge_has_all_once(shown: Path, tmp_path: Path) -> None:
    part, both = tmp_path / "part.mcap", tmp_path / "both.mcap"
    cut(shown, part, at(5.0), at(6.0))
    kept = read_recording(part)
    assert kept.shown["/foxglove/scene/arm"] == kept.shown["/foxglove/scene/plate"] == 1
    assert 45 <= kept.shown["/foxglove/joint_states"] <= 55
    merge([shown, part], both)
    assert dict(read_recording(both).shown) == dict(read_recording(shown).shown)


def test_assemblies_are_a_dataset(recorded: Path, tmp_path: Path) -> None:
    out = tmp_path / "dataset"
    done = CliRunner().invoke(app, ["recording", "export", "lerobot", str(recorded), "-o", str(out), "--fps", str(FPS)])
    assert done.exit_code == 0, done.output
    info = json.loads((out / "meta" / "info.json").read_text(encoding="utf-8"))
    rows = pyarrow.parquet.read_table(out / "data" / "chunk-000" / "file-000.parquet")
    features = info["features"]
    assert set(rows.column_names) == {name for name, one in features.items() if one["dtype"] != "video"}
    assert info["total_frames"] == len(rows) and info["total_episodes"] == 1 and info["codebase_version"] == "v3.0"
    assert np.allclose(np.diff(rows["timestamp"].to_numpy()), 1.0 / FPS, atol=1e-6)
    state = np.array(rows["observation.state"].to_pylist())
    assert np.array_equal(np.array(rows["action"].to_pylist())[:-1], state[1:])
    assert rows["next.success"].to_pylist() == rows["next.done"].to_pylist() == [False] * (len(rows) - 1) + [True]
    names = pyarrow.parquet.read_table(out / "meta" / "subtasks.parquet")
    assert names["subtask"].to_pylist() == list(PHASES)
    assert PHASES[rows["subtask_index"].to_pylist()[-1]] in ("seated", "done")
    with av.open(str(out / "videos" / "observation.images.left" / "chunk-000" / "file-000.mp4")) as video:
        frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    assert len(frames) == len(rows)
    pixels = seen("camera_left", 0).pixels
    assert np.abs(frames[-1].astype(int) - pixels.astype(int)).mean() < 6.0


def test_the_truth_is_in_topics_of_the_truth_alone(recorded: Path, shown: Path) -> None:
    assert read_recording(recorded).messages(TRUTH)
    marked = {name for name in read_recording(shown).shown if "/truth/" in name}
    assert {"/foxglove/truth/transforms", "/foxglove/truth/rim"} <= marked
    assert read_recording(shown).span_ns()[0] <= START_NS + 10**9
