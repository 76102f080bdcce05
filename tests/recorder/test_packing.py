"""Messages whose fields are packed at once make the same file as those that the library writes."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from services.recorder import packing
from services.recorder.packing import PackingWriter

Row = tuple[int, int, bytes, int, int]
ROWS = st.lists(
    st.tuples(
        st.integers(1, 3), st.integers(0, 2**63 - 1), st.binary(max_size=900), st.integers(0, 2**63 - 1),
        st.integers(0, 2**32 - 1),
    ),
    max_size=40,
)  # fmt: skip


def written(kind: type[Writer], rows: list[Row], compression: CompressionType) -> bytes:
    stream = BytesIO()
    writer: Any = kind(stream, chunk_size=2000, compression=compression)
    writer.start()
    schema = writer.register_schema("a", "jsonschema", b"{}")
    for channel in ("x", "y", "z"):
        writer.register_channel(channel, "json", schema)
    for channel_id, log_time, data, publish_time, sequence in rows:
        writer.add_message(channel_id, log_time, data, publish_time, sequence)
    writer.finish()
    return stream.getvalue()


@given(rows=ROWS, compression=st.sampled_from([CompressionType.NONE, CompressionType.ZSTD]))
def test_the_file_is_the_same_to_the_byte(rows: list[Row], compression: CompressionType) -> None:
    assert written(PackingWriter, rows, compression) == written(Writer, rows, compression)


def test_without_the_librarys_inner_parts_the_library_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing, "_INNER", ("no_such_part",) * 3)
    rows = [(1, 5, b"five", 6, 0)]
    assert written(PackingWriter, rows, CompressionType.NONE) == written(Writer, rows, CompressionType.NONE)
