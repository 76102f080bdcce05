"""The table of contacts, one row a sample, in a folder of Parquet files.

Rows are written in parts that are never rewritten, so that an interrupted run loses only unwritten rows.
`ContactWriter.close` joins the parts into one file. Any Parquet reader opens the folder. The files' metadata, under the
key `crosspih`, holds the origin of the rows as JSON (`DatasetOrigin`).

Lists have a fixed length. If a push felt nothing, `outcome` says so and the measured columns are null.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError

from crosspih_common.errors import CrosspihError
from crosspih_common.geometry.pose import Array
from crosspih_common.messages.base import Vector3, Vector6
from crosspih_common.provenance import Measured, record_measured

SCHEMA_VERSION = 1
CONTACT = "contact"
_METADATA = b"crosspih"
_JOINED = "contacts.parquet"
_PART = "part-"

# name -> (length of the list or None for a plain value, kind, what it is)
CONTACT_COLUMNS: dict[str, tuple[int | None, str, str]] = {
    "seed": (None, "int64", "of the cell's draws in this sample: sensor noise and all"),
    "pose_seed": (None, "int64", "of the pose error: repeats of one pose have it in common"),
    "repeat": (None, "int64", "counts the repeats of a pose from 0"),
    "outcome": (None, "string", "`contact`, or why there was none"),
    "angles_rad": (3, "double", "alpha, beta, gamma of the hole in the peg frame, as drawn"),
    "translation_m": (3, "double", "x, y, z of the hole's rim in the peg frame, at the reading"),
    "wrench": (6, "double", "contact wrench on the peg, peg frame, compensated: Fx Fy Fz in N, Mx My Mz in Nm"),
    "wrench_sd": (6, "double", "standard deviation of that mean"),
    "state": (None, "string", "contact state w1-w2-w3 as the classifier says; null for none of the 26"),
    "state_confidence": (None, "double", "0 to 1"),
    "n_z0": (None, "double", "|Fz| over |F| (Eq. 17)"),
    "direction_peg": (3, "double", "unit direction of the push, peg frame"),
    "travel_m": (None, "double", "from the start to the first contact"),
}


class DatasetError(CrosspihError):
    """A data set that cannot be read, or whose origin differs from that of the rows to be added."""


class DatasetOrigin(BaseModel):
    """Where a data set's rows come from."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: int = SCHEMA_VERSION
    made_by: str
    command: str
    first_seed: int
    poses: int
    repeats: int = 1
    cell_sha256: str
    settings: dict[str, float]
    code: str = ""
    version: str = ""

    def same_draws(self, other: DatasetOrigin) -> bool:
        """Whether rows of both can stand in one table: same cell, same settings, same maker, same code."""
        return not self.differs_in(other)

    def differs_in(self, other: DatasetOrigin) -> list[str]:
        """The differences between both origins, in words; empty if their rows can stand in one table."""
        said = {
            "made_by": "made by another maker", "cell_sha256": "of another cell", "settings": "with other settings",
            "schema_version": "in another version of the table",
            "code": f"by other code ({self.code or 'which is not said'}, not {other.code or 'said'})",
        }  # fmt: skip
        return [words for name, words in said.items() if getattr(self, name) != getattr(other, name)]

    def draws(self, pose_seed: int, repeat: int) -> bool:
        """Whether the command of this origin makes a row with this seed and repeat."""
        return self.first_seed <= pose_seed < self.first_seed + self.poses and repeat < self.repeats


class ContactRow(BaseModel):
    """One sample; the fields are the columns of `CONTACT_COLUMNS`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int
    pose_seed: int
    repeat: int = 0
    outcome: str = CONTACT
    angles_rad: Vector3
    translation_m: Vector3 | None = None
    wrench: Vector6 | None = None
    wrench_sd: Vector6 | None = None
    state: str | None = None
    state_confidence: float | None = None
    n_z0: float | None = None
    direction_peg: Vector3 = (0.0, 0.0, 1.0)
    travel_m: float | None = None


def _schema(origin: DatasetOrigin) -> Any:
    fields = []
    for name, (length, kind, doc) in CONTACT_COLUMNS.items():
        value: Any = {"int64": pa.int64(), "double": pa.float64(), "string": pa.string()}[kind]
        fields.append(
            pa.field(name, value if length is None else pa.list_(value, length), metadata={b"doc": doc.encode()})
        )
    return pa.schema(fields, metadata={_METADATA: origin.model_dump_json().encode()})


class ContactTable:
    """Rows in the order of their seeds, each seed once, and where they come from."""

    def __init__(self, table: Any, origin: DatasetOrigin) -> None:
        order = np.argsort(table["seed"].to_numpy(), kind="stable")
        seeds = table["seed"].to_numpy()[order]
        first = np.concatenate([[True], seeds[1:] != seeds[:-1]]) if len(seeds) else np.zeros(0, bool)
        self.table = table.take(pa.array(order[first])).combine_chunks()
        self.origin = origin

    def __len__(self) -> int:
        return int(self.table.num_rows)

    def touched(self) -> ContactTable:
        """Only the rows in which something was touched."""
        mask = np.array([outcome == CONTACT for outcome in self.table["outcome"].to_pylist()], bool)
        return ContactTable(self.table.filter(pa.array(mask)), self.origin)

    def numbers(self, name: str) -> Array:
        """A column as floats (n,) or (n, length); NaN where it is null. KeyError for a name that is no column."""
        length, _, _ = CONTACT_COLUMNS[name]
        if length is None:
            return np.asarray(self.table[name].to_numpy(zero_copy_only=False), dtype=float)
        empty = [np.nan] * length
        rows = [empty if row is None else row for row in self.table[name].to_pylist()]
        return np.asarray(rows, dtype=float).reshape(-1, length)

    def integers(self, name: str) -> NDArray[np.int64]:
        """A column of whole numbers without nulls, (n,)."""
        return np.asarray(self.table[name].to_numpy(), dtype=np.int64)

    def strings(self, name: str, instead_of_null: str) -> NDArray[np.str_]:
        """A column of strings, (n,)."""
        return np.array([instead_of_null if value is None else value for value in self.table[name].to_pylist()], str)

    def sha256(self) -> str:
        """A hash of all rows; it does not depend on the files' layout or the order of the rows in them."""
        digest = hashlib.sha256()
        for row in self.table.to_pylist():
            digest.update(json.dumps(row, sort_keys=True).encode())
        return digest.hexdigest()


def read_contacts(path: Path) -> ContactTable:
    """The data set in a folder, or in one Parquet file. DatasetError says what is wrong with it."""
    files = sorted(path.glob("*.parquet")) if path.is_dir() else [path]
    if not files or not path.exists():
        raise DatasetError(f"{path}: no contacts there; collect some with `crosspih dataset collect`")
    tables = []
    for file in files:
        try:
            tables.append(pq.ParquetFile(file).read())
        except (OSError, pa.ArrowException) as error:
            raise DatasetError(f"{file}: cannot be read as Parquet ({error}); remove it") from None
    origin = _origin(files[0], tables[0])
    wanted = _schema(origin)
    for file, table in zip(files, tables, strict=True):
        if table.schema.names != wanted.names:
            missing = sorted(set(wanted.names) ^ set(table.schema.names))
            raise DatasetError(f"{file}: columns {missing} differ from this version's: make the data set anew")
        if differs := _origin(file, table).differs_in(origin):
            raise DatasetError(
                f"{file} holds rows {', '.join(differs)} than {files[0].name} does: keep them in two folders"
            )
    return ContactTable(pa.concat_tables([table.cast(wanted) for table in tables]), origin)


def _origin(file: Path, table: Any) -> DatasetOrigin:
    text = (table.schema.metadata or {}).get(_METADATA)
    if text is None:
        raise DatasetError(f"{file}: does not say where its rows come from: it is no data set of contacts")
    try:
        return DatasetOrigin.model_validate_json(text)
    except ValidationError as error:
        raise DatasetError(f"{file}: {error}") from None


class ContactWriter:
    """Adds rows to a data set's folder; `done` are the seeds that it has already.

    Raises DatasetError if the folder holds rows of other settings or other code, or rows that the origin's command does
    not make: all rows always come from the command that the files name. One writer at a time.
    """

    def __init__(self, folder: Path, origin: DatasetOrigin) -> None:
        self.folder, self.origin = folder, origin
        self.done: set[int] = set()
        self._made = 0
        if folder.is_dir() and any(folder.glob("*.parquet")):
            known = read_contacts(folder)
            if differs := known.origin.differs_in(origin):
                raise DatasetError(
                    f"{folder} holds contacts {', '.join(differs)} ({known.origin.command}): name another folder"
                )
            drawn = zip(known.integers("pose_seed").tolist(), known.integers("repeat").tolist(), strict=True)
            if others := sum(not origin.draws(*one) for one in drawn):
                raise DatasetError(
                    f"{folder} holds {others} contacts that this command does not make ({known.origin.command}): the "
                    f"data set would not be what its command says; ask for those as well, or name another folder"
                )
            self.done = set(known.integers("seed").tolist())
        folder.mkdir(parents=True, exist_ok=True)
        self._next = 1 + max((int(part.stem[len(_PART) :]) for part in folder.glob(f"{_PART}*.parquet")), default=-1)

    def put(self, rows: Sequence[ContactRow]) -> None:
        """Write rows as a new part, whole or not at all."""
        if not rows:
            return
        table = pa.Table.from_pylist([row.model_dump() for row in rows], schema=_schema(self.origin))
        self._write(table, self.folder / f"{_PART}{self._next:06d}.parquet")
        self._next += 1
        self.done |= {row.seed for row in rows}
        self._made += len(rows)

    def _write(self, table: Any, path: Path) -> None:
        half = path.with_suffix(".half")
        pq.write_table(table, half, compression="zstd")
        os.replace(half, path)

    def close(self) -> None:
        """Join all parts into one file, and record how many rows were reused and made. A second call does nothing."""
        record_measured(Measured(taken=len(self.done) - self._made, made=self._made, taken_s=None))
        parts = sorted(self.folder.glob(f"{_PART}*.parquet"))
        if not parts:
            return
        whole = read_contacts(self.folder)
        # if this is interrupted between the next two lines, the reader drops the rows that it finds twice
        self._write(whole.table.replace_schema_metadata(_schema(self.origin).metadata), self.folder / _JOINED)
        for part in parts:
            part.unlink()

    def __enter__(self) -> ContactWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
