"""`crosspih recording`: info, check, recover, cut, merge and export, over recordings with known content."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from crosspih_common.keys import ANNOTATED_LEFT, CONTACT_WRENCH, PHASE, TRUTH
from crosspih_common.recording import read_recording
from services.operator.cli.commands import app
from tests.recorder.synthetic import STEPS, write_assembly


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "a.mcap"
    write_assembly(path)
    return path


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["recording", *map(str, arguments)], env={"COLUMNS": "200"})


def json_of(*arguments: object) -> Any:
    done = run(*arguments, "--json")
    return json.loads(done.stdout)


def by_mcap(path: Path) -> list[tuple[str, int, int, bytes]]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        return [
            (channel.topic, message.sequence, message.log_time, message.data)
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]


def damaged_in_a_chunk(path: Path) -> bytes:
    """64 bytes of its last chunk but one."""
    data = bytearray(path.read_bytes())
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[-2]
    at = chunk.chunk_start_offset + chunk.chunk_length // 2
    data[at : at + 64] = bytes(64)
    return bytes(data)


def test_info_tells_what_is_in_it(recording: Path) -> None:
    found = json_of("info", recording)
    channels = {row["key"].removeprefix("crosspih/synth/"): row for row in found["channels"]}
    assert found["cell"] == "synth" and found["finished"] and len(found["parts"]) == 1
    assert found["messages"] == len(by_mcap(recording)) == sum(row["messages"] for row in channels.values())
    wrench = channels[CONTACT_WRENCH.path]
    assert wrench["messages"] == 1240 and wrench["rate_hz"] == pytest.approx(100.0)
    assert wrench["type"] == "crosspih.ContactWrench" and wrench["missing"] == 0
    assert channels[PHASE.path]["messages"] == len(STEPS) and channels[TRUTH.path]["rate_hz"] is None
    assert found["parts"][0]["bytes"] == recording.stat().st_size
    assert [one["name"] for one in found["parts"][0]["attachments"]] == ["channels"]
    shown = run("info", recording)
    assert shown.exit_code == 0 and "force_torque/wrench" in shown.output and "1240" in shown.output


def test_check_finds_nothing_wrong_with_a_whole_one(recording: Path) -> None:
    done = run("check", recording)
    assert done.exit_code == 0 and done.output.startswith("whole: "), done.output
    assert json_of("check", recording)["findings"] == []


def test_check_names_what_is_wrong(recording: Path, tmp_path: Path) -> None:
    whole = recording.read_bytes()
    damaged = damaged_in_a_chunk(recording)
    cases = {
        "torn": whole[: len(whole) // 2],
        "damaged": damaged,
        "no_end": whole[: whole.rindex(b"drops") - 13],
    }
    for name, data in cases.items():
        (tmp_path / f"{name}.mcap").write_bytes(data)
    assert {one["what"] for one in json_of("check", tmp_path / "damaged.mcap")["findings"]} >= {"damaged", "gap"}
    for name in ("torn", "no_end"):
        done = run("check", tmp_path / f"{name}.mcap")
        assert done.exit_code == 1 and f"{name}.mcap: " in done.output
    (tmp_path / "no.mcap").write_text("nothing")
    assert run("check", tmp_path / "no.mcap").exit_code == 1
    # a third part without a second one
    (tmp_path / "a.mcap").write_bytes(whole)
    (tmp_path / "a.part3.mcap").write_bytes(whole)
    found = json_of("check", tmp_path / "a.mcap")["findings"]
    assert {"what": "missing_part", "file": "a.mcap", "detail": "part 2 is not there"} in found


def test_recover_and_what_it_makes_is_whole(recording: Path, tmp_path: Path) -> None:
    (tmp_path / "d.mcap").write_bytes(damaged_in_a_chunk(recording))
    said = json_of("recover", tmp_path / "d.mcap", tmp_path / "out.mcap")
    told = by_mcap(tmp_path / "out.mcap")
    assert said["messages"] == len(told) and len(said["damage"]) == 1
    assert set(told) <= set(by_mcap(recording)) and len(told) > 0.5 * len(by_mcap(recording))
    assert read_recording(tmp_path / "out.mcap").finished
    again = run("recover", tmp_path / "d.mcap", tmp_path / "out.mcap")
    assert again.exit_code == 1 and "is there already" in again.output
    absent = run("recover", tmp_path / "absent.mcap", tmp_path / "more.mcap")
    assert absent.exit_code == 1 and not (tmp_path / "more.mcap").exists()


def test_cut_by_time_keeps_the_states_known_before(recording: Path, tmp_path: Path) -> None:
    done = run("cut", recording, tmp_path / "c.mcap", "--from", 5, "--to", 8)
    assert done.exit_code == 0, done.output
    told = read_recording(tmp_path / "c.mcap")
    whole = read_recording(recording)
    begin_ns = whole.span_ns()[0]  # there is no clock in it: the truth is its first sample
    stamps = [message.stamp_ns for message in told.messages(CONTACT_WRENCH)]
    assert stamps == [
        message.stamp_ns for message in whole.messages(CONTACT_WRENCH) if 5e9 <= message.stamp_ns - begin_ns <= 8e9
    ]
    assert told.messages(TRUTH) == whole.messages(TRUTH)
    assert told.metadata["cell"] == whole.metadata["cell"] and "drops" not in told.metadata
    assert run("cut", recording, tmp_path / "x.mcap").exit_code == 1
    assert run("cut", recording, tmp_path / "x.mcap", "--from", 5, "--to", 5).exit_code == 1
    assert not (tmp_path / "x.mcap").exists()


def test_cut_by_assembly(recording: Path, tmp_path: Path) -> None:
    assert run("cut", recording, tmp_path / "c.mcap", "--assembly", 1).exit_code == 0
    told = read_recording(tmp_path / "c.mcap")
    assert len(told.messages(PHASE)) == len(STEPS) and len(told.messages(ANNOTATED_LEFT)) == 1
    other = run("cut", recording, tmp_path / "x.mcap", "--assembly", 2)
    assert other.exit_code == 1 and "has 1" in other.output


def test_merge_gives_back_what_was_cut_apart(recording: Path, tmp_path: Path) -> None:
    one, two, out = tmp_path / "1.mcap", tmp_path / "2.mcap", tmp_path / "m.mcap"
    assert run("cut", recording, one, "--to", 7).exit_code == 0
    assert run("cut", recording, two, "--from", 6).exit_code == 0
    done = run("merge", two, one, "-o", out)
    assert done.exit_code == 0 and "more than once" in done.output
    told = by_mcap(out)
    assert sorted(told) == sorted(by_mcap(recording))
    assert [entry[2] for entry in told] == sorted(entry[2] for entry in told)


def test_merge_of_what_holds_nothing_fails_and_says_so(recording: Path, tmp_path: Path) -> None:
    empty, torn = tmp_path / "empty.mcap", tmp_path / "torn.mcap"
    empty.write_bytes(b"")
    torn.write_bytes(b"no recording at all")
    for bad in (empty, torn, tmp_path / "missing.mcap"):
        done = run("merge", recording, bad, "-o", tmp_path / "out.mcap")
        assert done.exit_code == 1 and bad.name in done.output and done.output.count("\n") == 1, done.output
        assert not (tmp_path / "out.mcap").exists()


def test_tables(recording: Path, tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    assert run("export", "csv", recording, tmp_path / "csv").exit_code == 0
    assert run("export", "parquet", recording, tmp_path / "parquet").exit_code == 0
    whole = read_recording(recording)
    wrenches = whole.messages(CONTACT_WRENCH)
    with (tmp_path / "csv" / "force_torque.wrench.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["wrench.2"]) for row in rows] == [message.wrench[2] for message in wrenches]
    assert [int(row["stamp_ns"]) for row in rows] == [message.stamp_ns for message in wrenches]
    assert {row["in_contact"] for row in rows} == {"False"}
    table = pq.read_table(tmp_path / "parquet" / "force_torque.wrench.parquet").to_pydict()
    assert [tuple(wrench) for wrench in table["wrench"]] == [message.wrench for message in wrenches]
    phases = pq.read_table(tmp_path / "parquet" / "planning.phase.parquet").to_pydict()
    assert phases["text"] == [text for _, _, text in STEPS]
    assert phases["figures.force_n"] == [12.5 if phase.value == "pushing" else None for _, phase, _ in STEPS]
    picture = pq.read_table(tmp_path / "parquet" / "vision.annotated.left.parquet").to_pydict()
    assert picture["width"] == [640] and len(picture["data"][0]) == 640 * 480 * 3
    with (tmp_path / "csv" / "vision.annotated.left.csv").open(newline="") as stream:
        assert "data" not in next(csv.reader(stream))
    assert {file.stem for file in (tmp_path / "csv").iterdir()} == {
        file.stem for file in (tmp_path / "parquet").iterdir()
    }
    there = run("export", "csv", recording, tmp_path / "csv")
    assert there.exit_code == 1 and "is there already" in there.output
    one = run("export", "csv", recording, tmp_path / "one", "--key", "planning/phase")
    assert one.exit_code == 0 and [file.name for file in (tmp_path / "one").iterdir()] == ["planning.phase.csv"]
    assert run("export", "csv", recording, tmp_path / "none", "--key", "no/such").exit_code == 1
    assert not (tmp_path / "none").exists()
