"""A recording as tables, one per key: rows are messages, columns their fields. For CSV and Parquet."""

from __future__ import annotations

import csv as csv_module
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from google.protobuf.message import DecodeError

from crosspih_common.errors import ConfigError
from crosspih_common.keys import ROOT
from crosspih_common.messages.images import IMAGE_TYPE
from crosspih_common.recording import Recorded, Recording
from crosspih_common.recording.rerun import begun_ns

MAX_COLUMNS = 64  # longest list of numbers with a column each in CSV; a longer one is one column of JSON
Columns = dict[str, list[Any]]
OURS = ("stamp_ns", "seq")  # these already have columns of their own


def chosen(recording: Recording, keys: list[str]) -> dict[str, str]:
    """{key: file name without suffix} of the chosen keys: keys relative to the cell, or all. Raises ConfigError."""
    several = len({key.split("/")[1] for key in recording.samples if key.startswith(f"{ROOT}/")}) > 1
    names = {}
    for key in sorted(recording.samples):
        parts = key.split("/")
        names[key] = ".".join(parts[1 if several else 2 :]) or key.replace("/", ".")
    for asked in keys:
        if not any(_below(key) == asked for key in names):
            raise ConfigError(f"--key {asked}: not in {recording.path}; `crosspih recording info` lists its keys")
    return {key: name for key, name in names.items() if not keys or _below(key) in keys}


def _below(key: str) -> str:
    return "/".join(key.split("/")[2:])


def columns_of(recording: Recording, key: str) -> Columns:
    """{column: values}, all of one length, None where a message lacks the field. `t_s` is cell time since the recording
    began.

    Nested fields have dotted names, lists of numbers stay lists, any other list is JSON. A picture's bytes are in
    `data`. A message that cannot be decoded has only its times, and is listed in `recording.problems`.
    """
    start_ns, picture = begun_ns(recording), recording.schemas[key][0] == IMAGE_TYPE
    columns: Columns = {"t_s": [], "stamp_ns": [], "wall_ns": [], "seq": []}
    samples = recording.samples[key]
    for row, sample in enumerate(samples):
        values = {
            "t_s": (sample.stamp_ns - start_ns) * 1e-9,
            "stamp_ns": sample.stamp_ns,
            "wall_ns": sample.wall_ns,
            "seq": sample.seq,
        }
        try:
            fields = _picture(sample) if picture else dict(_flat(json.loads(sample.payload), ""))
            values |= {name: value for name, value in fields.items() if name not in OURS}
        except (ValueError, AttributeError, RecursionError, DecodeError) as error:
            recording.problems.append(f"{key}: message {sample.seq}: {type(error).__name__}: {error}")
        for name, value in values.items():
            columns.setdefault(name, [None] * row).append(value)
        for column in columns.values():
            if len(column) == row:
                column.append(None)
    return {name: _even(column) for name, column in columns.items()}


def _picture(sample: Recorded) -> dict[str, Any]:
    from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

    image: Any = RawImage.FromString(sample.payload)
    return {
        "frame": image.frame_id, "width": image.width, "height": image.height, "encoding": image.encoding,
        "step": image.step, "data": image.data,
    }  # fmt: skip


def _flat(value: dict[str, Any], before: str) -> Iterator[tuple[str, Any]]:
    for name, field in value.items():
        if isinstance(field, dict):
            yield from _flat(field, f"{before}{name}.")
        elif isinstance(field, list) and not all(_number(entry) for entry in field):
            yield f"{before}{name}", json.dumps(field)
        else:
            yield f"{before}{name}", field


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _even(column: list[Any]) -> list[Any]:
    """Values of one type: all floating where some rows are, and text where types differ otherwise."""
    kinds = {type(value) for value in column if value is not None}
    if kinds <= {bool} or kinds <= {int} or kinds <= {str} or kinds <= {bytes}:
        return column
    if kinds <= {int, float}:
        return [None if value is None else float(value) for value in column]
    if kinds <= {list}:
        return [None if value is None else [float(entry) for entry in value] for value in column]
    return [None if value is None else value if isinstance(value, str) else json.dumps(value) for value in column]


def write_csv(columns: Columns, path: Path) -> int:
    """Write a table as CSV: a list of numbers becomes a column per number; pictures without their bytes. Returns the
    number of rows.
    """
    flat: Columns = {}
    for name, column in columns.items():
        lists = [value for value in column if isinstance(value, list)]
        if any(isinstance(value, bytes) for value in column):
            continue
        if not lists:
            flat[name] = column
            continue
        length = max(map(len, lists))
        if length > MAX_COLUMNS or any(len(value) != length for value in lists):
            flat[name] = [None if value is None else json.dumps(value) for value in column]
            continue
        for index in range(length):
            flat[f"{name}.{index}"] = [None if value is None else value[index] for value in column]
    rows = len(columns["seq"])
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv_module.writer(stream)
        writer.writerow(flat)
        writer.writerows(zip(*flat.values(), strict=True))
    return rows


def write_parquet(columns: Columns, path: Path) -> int:
    """Write a table as Parquet; returns the number of rows. Raises ConfigError without pyarrow."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise ConfigError("Parquet needs pyarrow: pip install 'crosspih[export]'; or export csv") from None
    # a column without any value has no type that every reader knows
    arrays = {
        name: pyarrow.array(column, pyarrow.string() if all(value is None for value in column) else None)
        for name, column in columns.items()
    }
    pyarrow.parquet.write_table(pyarrow.table(arrays), path, compression="zstd")
    return len(columns["seq"])
