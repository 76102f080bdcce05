"""What is whole of a damaged recording comes back, exactly as it was; the mcap library's own reader is the witness."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel as McapChannel
from mcap.records import Chunk
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader, breakup_chunk

from crosspih_common.bus.codec import encode
from crosspih_common.keys import EVENTS, PHASE, STATUS, Topic
from crosspih_common.messages import AssemblyPhase, Event, Phase, ServiceState, ServiceStatus, Severity
from crosspih_common.recording import RecordingError, read_recording
from crosspih_common.recording.records import Attachment, Malformed, metadata_of, seal_of, sealed
from crosspih_common.recording.scanning import DEFINITIONS, repeated_definitions, scanning
from services.operator.recordings.making import recover
from services.recorder.config import Compression, RecorderConfig
from services.recorder.file import RecordingFile
from services.recorder.sample import Sample

MESSAGES = 600
A_FLUSH = 40  # messages
Told = tuple[str, int, int, int, bytes]  # key, number, log time, publish time, payload


def messages() -> Iterable[tuple[Topic[Any], str, Any]]:
    rng, text = random.Random(7), ""
    for index in range(MESSAGES):
        stamp_ns = 1_000_000 * index
        kind = index % 3
        if kind == 0:
            text = f"a step {rng.random()}"
            yield PHASE, "*", AssemblyPhase(stamp_ns=stamp_ns, seq=index, assembly_id="a", phase=Phase.IDLE, text=text)
        elif kind == 1:
            name = f"service{index * 6 // MESSAGES}"  # keys begin to be spoken on all along
            event = Event(stamp_ns=stamp_ns, seq=index, service=name, severity=Severity.INFO, code="c", text=text)
            yield EVENTS, name, event
        else:
            state = ServiceStatus(
                stamp_ns=stamp_ns, seq=index, service="s", state=ServiceState.READY, pid=index, uptime_s=rng.random()
            )
            yield STATUS, "s", state


def write(path: Path, compression: Compression, finish: bool) -> None:
    config = RecorderConfig(compression=compression)
    file = RecordingFile(path, path.open("xb"), config, {"cell": {"name": "c", "yaml": "cell: {name: c}\n"}})
    for index, (topic, service, value) in enumerate(messages()):
        sample = Sample(topic.key("c", service), topic, encode(value), value.seq, value.stamp_ns, 10**18 + index)
        file.write(sample)
        if index % A_FLUSH == A_FLUSH - 1:
            file.flush()
    if finish:
        file.finish({"drops": {"gaps_total": "0"}})
    else:
        file._stream.close()


@dataclass(frozen=True, repr=False)
class Original:
    """A recording, its messages chunk by chunk as the mcap library reads them, and where each chunk lies."""

    data: bytes
    chunks: list[tuple[int, int, list[Told]]]
    starts: list[int]

    def __repr__(self) -> str:
        return "Original()"  # in what hypothesis prints of a failure

    @property
    def all(self) -> list[Told]:
        return [told for _, _, chunk in self.chunks for told in chunk]


def original(path: Path) -> Original:
    """By the mcap library alone."""
    data = path.read_bytes()
    chunks: list[tuple[int, int, list[Told]]] = []
    starts = []
    topics: dict[int, str] = {}
    with path.open("rb") as stream:
        reader = StreamReader(stream, emit_chunks=True)
        at = 8
        try:
            for record in reader.records:
                end = reader._stream.count
                starts.append(at)
                if isinstance(record, Chunk):
                    told = []
                    for inner in breakup_chunk(record, validate_crc=True):
                        if isinstance(inner, McapMessage):
                            key = topics[inner.channel_id]
                            told.append((key, inner.sequence, inner.log_time, inner.publish_time, inner.data))
                        elif isinstance(inner, McapChannel):
                            topics[inner.id] = inner.topic
                    chunks.append((at, end, told))
                at = end
        except Exception:
            assert data[-8:] != data[:8]  # one without an end
    return Original(data, chunks, starts)


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Original]:
    folder = tmp_path_factory.mktemp("originals")
    found = {}
    for name, compression, finish in (
        ("finished", Compression.ZSTD, True),
        ("torn", Compression.ZSTD, False),
        ("lz4", Compression.LZ4, True),
        ("bare", Compression.NONE, False),
    ):
        write(folder / f"{name}.mcap", compression, finish)
        found[name] = original(folder / f"{name}.mcap")
        assert len(found[name].all) == MESSAGES and len(found[name].chunks) == MESSAGES // A_FLUSH
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damaged")


def recovered(data: bytes, folder: Path) -> tuple[list[Told], int]:
    """The messages of the mended file, as the mcap library reads them; how many of whole chunks had no key."""
    damaged, out = folder / "damaged.mcap", folder / "out.mcap"
    damaged.write_bytes(data)
    out.unlink(missing_ok=True)
    made = recover(damaged, out)
    with out.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == made.messages
        told = [
            (channel.topic, message.sequence, message.log_time, message.publish_time, message.data)
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]
        for record in reader.iter_metadata():
            if record.name == "cell":  # the words too are as they were, or absent
                assert record.metadata["yaml"] == "cell: {name: c}\n"
    # and what we read of the damaged file itself is the same
    ours = read_recording(damaged) if made.parts[0].records else None
    assert len(told) == (0 if ours is None else sum(map(len, ours.samples.values())))
    return told, sum(part.nameless for part in made.parts)


def untouched(whole: Original, damaged: bytes | bytearray) -> list[Told]:
    """The messages of the chunks whose bytes are as they were."""
    return [told for at, end, chunk in whole.chunks if damaged[at:end] == whole.data[at:end] for told in chunk]


def assert_exact_or_absent(told: list[Told], whole: Original) -> None:
    surplus = Counter(told) - Counter(whole.all)
    assert not surplus, f"never said: {list(surplus)[:2]}"


KINDS = st.sampled_from(["finished", "torn", "lz4", "bare"])
FEW = settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture])


@FEW
@given(kind=KINDS, where=st.floats(0.0, 1.0), garbage=st.binary(min_size=1, max_size=64))
def test_damage_in_one_place_costs_the_chunk_that_it_hits(
    kind: str, where: float, garbage: bytes, originals: dict[str, Original], folder: Path
) -> None:
    whole = originals[kind]
    data = bytearray(whole.data)
    at = round(where * (len(data) - len(garbage)))
    data[at : at + len(garbage)] = garbage
    told, nameless = recovered(bytes(data), folder)
    assert_exact_or_absent(told, whole)
    assert nameless == 0
    assert not Counter(untouched(whole, data)) - Counter(told)


@FEW
@given(
    kind=KINDS,
    damages=st.lists(st.tuples(st.floats(0.0, 1.0), st.binary(min_size=1, max_size=300)), min_size=2, max_size=8),
)
def test_damage_in_many_places(
    kind: str, damages: list[tuple[float, bytes]], originals: dict[str, Original], folder: Path
) -> None:
    whole = originals[kind]
    data = bytearray(whole.data)
    for where, garbage in damages:
        at = round(where * (len(data) - len(garbage)))
        data[at : at + len(garbage)] = garbage
    told, nameless = recovered(bytes(data), folder)
    assert_exact_or_absent(told, whole)
    # whose definition was hit in each place where it stands has no key, and is left out rather than guessed
    assert (Counter(untouched(whole, data)) - Counter(told)).total() == nameless


@FEW
@given(
    kind=KINDS,
    which=st.integers(0, 10**6),
    length=st.integers(0, 2**64 - 1),
    opcode=st.integers(0, 255),
    both=st.booleans(),
)
def test_damage_in_a_records_length_and_head(
    kind: str, which: int, length: int, opcode: int, both: bool, originals: dict[str, Original], folder: Path
) -> None:
    whole = originals[kind]
    data = bytearray(whole.data)
    at = whole.starts[which % len(whole.starts)]
    data[at + 1 : at + 9] = length.to_bytes(8, "little")
    if both:
        data[at] = opcode
    told, nameless = recovered(bytes(data), folder)
    assert_exact_or_absent(told, whole)
    assert nameless == 0 and not Counter(untouched(whole, data)) - Counter(told)
    # plausible lengths, such as lead into the middle of another record
    data[at + 1 : at + 9] = (length % len(data)).to_bytes(8, "little")
    told, nameless = recovered(bytes(data), folder)
    assert_exact_or_absent(told, whole)
    assert nameless == 0 and not Counter(untouched(whole, data)) - Counter(told)


@FEW
@given(kind=KINDS, where=st.floats(0.0, 1.0), count=st.integers(1, 5000))
def test_bytes_cut_out_or_put_in(
    kind: str, where: float, count: int, originals: dict[str, Original], folder: Path
) -> None:
    whole = originals[kind]
    at = round(where * len(whole.data))
    for data in (whole.data[:at] + whole.data[at + count :], whole.data[:at] + bytes(count) + whole.data[at:]):
        told, nameless = recovered(data, folder)
        assert_exact_or_absent(told, whole)
        expected = [
            entry
            for begin, end, chunk in whole.chunks
            if end <= at or begin >= at + (count if len(data) < len(whole.data) else 0)
            for entry in chunk
        ]
        assert (Counter(expected) - Counter(told)).total() == nameless


def test_truncated_at_a_hundred_places(originals: dict[str, Original], folder: Path) -> None:
    rng = random.Random(1)
    for kind, places in (("finished", 70), ("bare", 30)):
        whole = originals[kind]
        for cut in [0, 1, 7, 8, *(rng.randrange(len(whole.data)) for _ in range(places))]:
            told, nameless = recovered(whole.data[:cut], folder)
            assert told == [entry for _, end, chunk in whole.chunks if end <= cut for entry in chunk]
            assert nameless == 0


def test_what_is_no_recording_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "no.mcap").write_bytes(b"no recording" * 100)
    with pytest.raises(RecordingError, match="is no MCAP file"):
        recover(tmp_path / "no.mcap", tmp_path / "out.mcap")
    with pytest.raises(RecordingError, match="cannot be read"):
        recover(tmp_path / "absent.mcap", tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_parts_are_recovered_as_one(originals: dict[str, Original], tmp_path: Path) -> None:
    first, second = tmp_path / "x.mcap", tmp_path / "x.part2.mcap"
    first.write_bytes(originals["torn"].data[:-100])
    second.write_bytes(originals["finished"].data)
    made = recover(first, tmp_path / "out.mcap")
    kept = [entry for _, end, chunk in originals["torn"].chunks if end <= len(first.read_bytes()) for entry in chunk]
    assert made.messages == len(kept) + MESSAGES and [part.path for part in made.parts] == [first, second]


def test_the_first_chunk_does_not_take_the_keys_of_all_that_follow(
    originals: dict[str, Original], folder: Path
) -> None:
    """A torn file has no summary that repeats them: the recorder's attachments do."""
    whole = originals["torn"]
    data = bytearray(whole.data)
    begin, end, _ = whole.chunks[0]
    data[begin:end] = bytes(end - begin)
    told, nameless = recovered(bytes(data), folder)
    assert nameless == 0 and told == [entry for _, _, chunk in whole.chunks[1:] for entry in chunk]


def test_words_carry_a_check(tmp_path: Path, originals: dict[str, Original]) -> None:
    entries = {"a": "b", "": "x", "yaml": "cell: {}\n"}
    assert sealed("n", entries)["crc32"] == seal_of("n", entries) != seal_of("m", entries)
    assert seal_of("n", {"a": "bc"}) != seal_of("n", {"ab": "c"})
    whole = originals["finished"].data
    at = whole.index(b"cell: {name: c}")
    data = bytearray(whole)
    data[at] = ord("C")
    (tmp_path / "w.mcap").write_bytes(data)
    read = read_recording(tmp_path / "w.mcap")
    assert "cell" not in read.metadata and "metadata cell: its check fails" in read.tear
    assert sum(map(len, read.samples.values())) == MESSAGES
    with pytest.raises(Malformed):
        metadata_of(b"\x01\x00\x00\x00")


def test_noise_is_scanned_in_reasonable_steps(tmp_path: Path) -> None:
    """Much that looks like a beginning, and is none."""
    path = tmp_path / "noise.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + b"\x06\x40\x00\x00\x00\x00\x00\x00\x00" * 50_000)
    with scanning(path) as scan:
        found = list(scan)
    assert len(found) == 1


@pytest.mark.parametrize("says", [2**40, 2**63])
def test_an_attachment_that_says_it_unpacks_to_terabytes_asks_for_no_memory(says: int) -> None:
    # a zstd frame of one segment with its content's size in 8 bytes, and one block, the last, of three bytes
    frame = b"\x28\xb5\x2f\xfd\xe0" + says.to_bytes(8, "little") + b"\x19\x00\x00abc"
    assert repeated_definitions(Attachment(0, 0, DEFINITIONS, "application/zstd", frame)) == ()
