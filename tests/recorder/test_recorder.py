"""The recorder's core: files, states, counters, a bad disk; no bus."""

from __future__ import annotations

import queue
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from crosspih_common.bus.codec import encode
from crosspih_common.errors import CommandRefused, ContractError
from crosspih_common.keys import FT_CALIBRATION, IMAGE_LEFT, PHASE, Topic
from crosspih_common.messages import AssemblyPhase, FtCalibration, Image, Phase
from crosspih_common.recording import RecordingError, parts_of, read_recording
from services.recorder.broken_off import BrokenOff, broken_off
from services.recorder.config import RecorderConfig
from services.recorder.file import RecordingFile, create_file
from services.recorder.inbox import SMALL_BYTES, Inbox
from services.recorder.recorder import Recorder
from services.recorder.sample import Sample, Waiting, stamp_of

KEY = PHASE.key("c")


def phase(seq: int, text: str = "x") -> AssemblyPhase:
    return AssemblyPhase(stamp_ns=1000 + seq, seq=seq, assembly_id="a", phase=Phase.PUSHING, text=text)


def calibration(seq: int) -> FtCalibration:
    return FtCalibration(
        stamp_ns=seq,
        seq=seq,
        bias=(0.0,) * 6,
        weight_n=9.0 + seq,
        centroid_m=(0.0,) * 3,
        gravity_base=(0.0, 0.0, -1.0),
        residual_force_n=0.0,
        residual_moment_nm=0.0,
        poses=6,
    )


def feed(recorder: Recorder, topic: Topic[Any], value: Any) -> bool:
    """Whether there was room."""
    full: list[bool] = []
    key = topic.key("c")
    recorder.taker(topic, key, lambda: full.append(True), pytest.fail)(encode(value), value.seq)
    return not full


def make(tmp_path: Path, **settings: Any) -> tuple[Recorder, list[str]]:
    failures: list[str] = []
    config = RecorderConfig(directory=tmp_path / "r", quiet_s=0.0, **settings)
    return Recorder(config, lambda: {"cell": {"name": "c"}}, lambda code, text: failures.append(text)), failures


def test_every_file_begins_with_the_states_known(tmp_path: Path) -> None:
    recorder, failures = make(tmp_path)
    feed(recorder, FT_CALIBRATION, calibration(0))
    feed(recorder, FT_CALIBRATION, calibration(1))
    feed(recorder, PHASE, phase(0))
    paths = []
    for _ in range(2):
        paths.append(recorder.start("one", 0).path)
        recorder.stop(0)
    recorder.close()
    assert not failures
    assert [Path(path).name for path in paths] == ["one-0001.mcap", "one-0002.mcap"]
    for path in paths:
        recording = read_recording(path)
        assert [message.weight_n for message in recording.messages(FT_CALIBRATION)] == [10.0]
        assert recording.messages(PHASE) == []


def test_missing_numbers_are_counted_and_a_new_publisher_is_no_gap(tmp_path: Path) -> None:
    recorder, _ = make(tmp_path)
    path = recorder.start("gaps", 0).path
    for seq in (0, 1, 4, 5, 0, 1):
        feed(recorder, PHASE, phase(seq))
    status = recorder.stop(0)
    recorder.close()
    assert status.dropped == {KEY: 2}
    assert len(status.warnings) == 1 and status.warnings[0].startswith("2 samples never came")
    drops = read_recording(path).metadata["drops"]
    assert drops[f"gaps {KEY}"] == "2" and drops[f"restarts {KEY}"] == "1"
    assert read_recording(path).seq_gaps() == {KEY: 2}


def test_an_overflow_is_counted_and_the_rest_is_recorded(tmp_path: Path) -> None:
    recorder, _ = make(tmp_path, queue_samples=10)
    recorder.start("overflow", 0)
    with recorder._lock:  # the writer is stuck, as behind a slow disk
        taken = [feed(recorder, PHASE, phase(seq)) for seq in range(100)]
    status = recorder.stop(0)
    recorder.close()
    lost = taken.count(False)
    assert lost >= 80
    assert status.dropped == {KEY: lost}
    recording = read_recording(status.path)
    assert len(recording.messages(PHASE)) == 100 - lost
    assert recording.metadata["drops"]["overflow_total"] == str(lost)
    assert recording.metadata["drops"]["gaps_total"] == "0"


def test_a_payload_without_a_stamp_is_refused_and_counted(tmp_path: Path) -> None:
    recorder, _ = make(tmp_path)
    recorder.start("bad", 0)
    said: list[str] = []
    recorder.taker(PHASE, KEY, pytest.fail, said.append)(b"not json", 0)
    status = recorder.stop(0)
    recorder.close()
    assert len(said) == 1 and said[0].startswith(KEY) and "stamp_ns" in said[0]
    assert status.dropped == {KEY: 1}


def test_a_stamp_is_the_same_however_it_is_written(tmp_path: Path) -> None:
    recorder, failures = make(tmp_path)
    path = recorder.start("stamps", 0).path
    said: list[str] = []
    take = recorder.taker(PHASE, KEY, pytest.fail, said.append)
    stamps = {
        b'{"stamp_ns":12,"a":1}': 12, b'{"stamp_ns":13}': 13, b'{"stamp_ns":14 , "a":1}': 14,
        b' {"stamp_ns" : 15 }': 15, b'{"stamp_ns":-1,"a":1}': 0, b'{"a":7,"stamp_ns":16}': 16,
        b'{"stamp_ns":%d,"a":1}' % (2**63 - 1): 2**63 - 1,
    }  # fmt: skip
    wrong = (
        b'{"stamp_ns":1_7,"a":1}', b'{"stamp_nz":18,"a":1}', b'{"stamp_ns":"19","a":1}', b'{"stamp_ns":%d}' % 10**25,
    )  # fmt: skip
    for seq, payload in enumerate([*stamps, *wrong]):
        take(payload, seq)
    dropped = recorder.stop(0).dropped
    recorder.close()
    assert not failures
    assert dropped == {KEY: len(wrong)} and len(said) == len(wrong)
    assert [sample.stamp_ns for sample in read_recording(path).samples[KEY]] == [*stamps.values()]


def test_a_directory_that_cannot_be_made_is_a_refusal(tmp_path: Path) -> None:
    (tmp_path / "r").write_text("a file where the directory should be")
    recorder, failures = make(tmp_path)
    said = recorder.start("x", 0)
    assert not said.recording and "recorder.directory" in said.trouble
    assert recorder.status() == said
    recorder.close()
    assert not failures
    strict, _ = make(tmp_path, required=True)
    with pytest.raises(CommandRefused, match=r"recorder\.directory"):
        strict.start("x", 0)
    strict.close()


def test_a_full_disk_ends_the_file_and_not_the_recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder, failures = make(tmp_path, flush_s=0.01)
    recorder.start("full", 0)
    reported = threading.Event()

    def report(code: str, why: str) -> None:
        if code == "recording_failed":
            failures.append(why)
            reported.set()

    recorder._tell = report

    def no_room(*sample: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Writer, "add_message", no_room)
        feed(recorder, PHASE, phase(0))
        feed(recorder, PHASE, phase(1))
        assert reported.wait(10.0)
    assert len(failures) == 1 and "No space left" in failures[0]
    assert not recorder.status().recording and "No space left" in recorder.status().trouble
    stopped = recorder.stop(0)
    assert not stopped.recording and stopped.dropped[KEY] >= 1
    assert list((tmp_path / "r").iterdir()) == []  # nothing was written, and so nothing is left
    again = recorder.start("full", 0)
    assert again.recording and again.path.endswith("full-0001.mcap") and again.trouble == ""
    feed(recorder, PHASE, phase(2))
    recorder.close()
    assert len(read_recording(again.path).messages(PHASE)) == 1


def test_a_disk_that_was_full_for_a_while_costs_that_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder, _ = make(tmp_path, flush_s=0.01, retry_s=0.01)
    said: queue.Queue[str] = queue.Queue()
    recorder._tell = lambda code, text: said.put(code)
    feed(recorder, FT_CALIBRATION, calibration(0))
    path = Path(recorder.start("while", 0).path)
    for seq in range(20):
        feed(recorder, PHASE, phase(seq))
    assert recorder._inbox.drain(10.0)

    def no_room(*sample: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Writer, "add_message", no_room)
        patch.setattr("services.recorder.tape.shutil.disk_usage", lambda folder: SimpleNamespace(free=0))
        for seq in range(20, 30):
            feed(recorder, PHASE, phase(seq))
        assert said.get(timeout=10.0) == "recording_failed"
        assert recorder._inbox.drain(10.0)
    while said.get(timeout=10.0) != "recording_resumed":
        pass
    for seq in range(30, 40):
        feed(recorder, PHASE, phase(seq))
    stopped = recorder.stop(0)
    recorder.close()
    assert list(map(Path, stopped.parts)) == parts_of(path) == [path, path.with_name("while-0001.part2.mcap")]
    assert stopped.path == str(path)
    recording = read_recording(path)
    numbers = [message.seq for message in recording.messages(PHASE)]
    kept = numbers.index(30)
    assert numbers == [*range(kept), *range(30, 40)] and kept <= 20
    assert stopped.dropped == {KEY: 30 - kept} and stopped.messages == len(numbers) + 2
    assert [message.weight_n for message in recording.messages(FT_CALIBRATION)] == [9.0]  # in both, read once
    assert recording.metadata["drops"][f"unwritten {KEY}"] == str(30 - kept)
    assert [part.finished for part in recording.parts] == [False, True]
    assert any("did not get into the recording" in warning for warning in stopped.warnings)
    assert any("goes on in" in warning for warning in stopped.warnings)


def test_a_full_disk_is_told_and_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.recorder.tape.shutil.disk_usage", lambda folder: SimpleNamespace(free=10**6))
    recorder, _ = make(tmp_path)
    said = recorder.start("full", 0)
    recorder.close()
    assert not said.recording and "1.0 MB are free" in said.trouble and "free some space" in said.trouble
    assert not (tmp_path / "r").exists()


def left_behind(tmp_path: Path, boot_id: str = "b", within_s: float = 60.0) -> BrokenOff | None:
    return broken_off(tmp_path / "r", "c", boot_id, within_s)


def words(boot_id: str) -> dict[str, dict[str, str]]:
    return {"cell": {"name": "c"}, "recording": {"boot_id": boot_id}}


def test_a_successor_goes_on_in_a_new_part(tmp_path: Path) -> None:
    config = RecorderConfig(directory=tmp_path / "r", quiet_s=0.0)
    said: list[str] = []

    def successor() -> Recorder:
        return Recorder(config, lambda: words("b"), lambda code, text: said.append(code), lambda: left_behind(tmp_path))

    path = None
    for number in range(3):
        recorder = successor()
        if number == 0:
            path = Path(recorder.start("again", 0).path)
        for seq in range(10 * number, 10 * number + 8):
            feed(recorder, PHASE, phase(seq))
        assert recorder._inbox.drain(10.0)
        recorder.close()  # as on SIGTERM: nobody asked for an end
    assert path is not None
    last = successor()
    stopped = last.stop(0)
    last.close()
    assert [Path(part).name for part in stopped.parts] == [
        "again-0001.mcap", "again-0001.part2.mcap", "again-0001.part3.mcap", "again-0001.part4.mcap",
    ]  # fmt: skip
    assert stopped.path == str(path) and said == ["recording_resumed"] * 3
    assert any("the recorder was gone for" in warning for warning in stopped.warnings)
    recording = read_recording(path)
    assert [message.seq for message in recording.messages(PHASE)] == [
        seq for number in range(3) for seq in range(10 * number, 10 * number + 8)
    ]
    assert recording.seq_gaps() == {KEY: 4}
    assert [part.metadata["recording"]["part"] for part in recording.parts] == ["1", "2", "3", "4"]
    # now that its end was asked for, nobody goes on with it; nor in another run of the cell, nor much later
    assert left_behind(tmp_path) is None
    path.with_name("again-0001.part4.mcap").unlink()
    assert left_behind(tmp_path) is not None
    assert left_behind(tmp_path, boot_id="other") is None
    assert left_behind(tmp_path, within_s=0.0) is None
    # a name whose first part is gone is taken all the same
    path.unlink()
    taken, stream = create_file(tmp_path / "r", "again")
    stream.close()
    assert taken.name == "again-0002.mcap"


def test_a_file_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "x-0041.mcap").write_bytes(b"precious")
    path, stream = create_file(tmp_path, "x")
    stream.close()
    assert path.name == "x-0042.mcap"
    outside, stream = create_file(tmp_path, "../../etc/passwd")
    stream.close()
    assert outside.parent == tmp_path.resolve()
    unnamed, stream = create_file(tmp_path, "///")
    stream.close()
    assert unnamed.name == "recording-0001.mcap"


@settings(deadline=None)
@given(cut=st.floats(0.0, 1.0), garbage=st.binary(max_size=64))
def test_a_file_torn_anywhere_reads_up_to_the_tear(cut: float, garbage: bytes, tmp_path_factory: Any) -> None:
    directory = tmp_path_factory.mktemp("torn")
    path, stream = create_file(directory, "t")
    file = RecordingFile(path, stream, RecorderConfig(), {"cell": {"name": "c"}})
    for seq in range(60):
        payload = encode(phase(seq))
        file.write(Sample(KEY, PHASE, payload, seq, 1000 + seq, 0))
        if seq % 10 == 9:
            file.flush()
    file.finish({"drops": {}})
    whole = path.read_bytes()
    path.write_bytes(whole[: int(cut * len(whole))] + garbage)
    try:
        recording = read_recording(path)
    except RecordingError:
        assert cut * len(whole) < 100  # before the header
        return
    numbers = [message.seq for message in recording.messages(PHASE)]
    assert numbers == list(range(len(numbers)))
    if cut == 1.0:
        assert len(numbers) == 60


def test_the_stamp_is_read_without_decoding() -> None:
    assert stamp_of(PHASE, encode(phase(7))) == 1007
    assert stamp_of(PHASE, b'{"seq": 1, "stamp_ns": 12}') == 12
    picture = Image("camera_left", np.zeros((4, 6), np.uint8), stamp_ns=5_000_000_123, seq=0)
    assert stamp_of(IMAGE_LEFT, encode(picture)) == 5_000_000_123
    for payload in (b"", b"\x0a", b"\xff\xff\xff", b"{}"):
        with pytest.raises(ContractError):
            stamp_of(IMAGE_LEFT, payload)
    endless = b'{"a":' * 100_000
    for payload in (b"", b"[]", b"{}", b'{"stamp_ns": 1.5}', b'{"stamp_ns": 99999999999999999999}', endless):
        with pytest.raises(ContractError):
            stamp_of(PHASE, payload)


def test_an_inbox_is_bounded_in_bytes_too() -> None:
    size = 2 * SMALL_BYTES
    inbox = Inbox(4, 3 * SMALL_BYTES)
    offer, large, small = inbox.offerer(), ("k", PHASE, b"x" * size, 0, 0, 0), ("k", PHASE, b"x", 0, 0, 0)
    assert offer(large, size)
    assert not offer(large, size)
    assert offer(small, 1) and offer(small, 1) and offer(small, 1)
    assert not offer(small, 1)  # of these the number is bounded
    assert inbox.take(0.0) == [large, small, small, small]
    assert not inbox.drain(0.0)
    inbox.settle(4)
    assert inbox.drain(0.0)
    assert offer(large, size)


def test_an_inbox_keeps_the_order_of_each_thread_and_wakes_who_takes() -> None:
    inbox, each = Inbox(1_000_000, 1), 5000
    taken: list[Waiting] = []

    def put(name: str) -> None:
        offer = inbox.offerer()
        for seq in range(each):
            assert offer((name, PHASE, b"", seq, 0, 0), 0)

    threads = [threading.Thread(target=put, args=(name,)) for name in "abc"]
    for thread in threads:
        thread.start()
    while len(taken) < 3 * each:
        batch = inbox.take(60.0)  # nobody waits so long
        assert batch
        inbox.settle(len(batch))
        taken += batch
    for thread in threads:
        thread.join()
    assert inbox.drain(0.0)
    assert all([one[3] for one in taken if one[0] == name] == list(range(each)) for name in "abc")
