"""The table of contacts: what is written is read, gone on with, and not mixed with what was made otherwise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from crosspih_common.datasets import (
    CONTACT_COLUMNS,
    ContactRow,
    ContactWriter,
    DatasetError,
    DatasetOrigin,
    read_contacts,
)

ORIGIN = DatasetOrigin(
    made_by="test", command="none", first_seed=0, poses=6, cell_sha256="0" * 64, settings={"angle_rad": 0.1}
)


def row(seed: int, **other: object) -> ContactRow:
    content = {"angles_rad": (seed * 0.1, 0.0, -0.1), "wrench": (1.0, 2.0, 3.0, 4.0, 5.0, float(seed))}
    return ContactRow.model_validate({"seed": seed, "pose_seed": seed % 4, **content, **other})


def test_the_row_has_the_documented_columns() -> None:
    assert list(ContactRow.model_fields) == list(CONTACT_COLUMNS)


def test_what_is_written_is_read_and_a_second_run_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    first = ContactWriter(folder, ORIGIN)
    first.put([row(3), row(1, state="1-2-2", n_z0=0.25)])
    first.put([row(0, outcome="felt nothing", wrench=None)])
    # stopped here: nothing was joined, all of it is there
    assert read_contacts(folder).integers("seed").tolist() == [0, 1, 3]
    with ContactWriter(folder, ORIGIN) as second:
        assert second.done == {0, 1, 3}
        second.put([row(2)])
    assert [path.name for path in folder.iterdir()] == ["contacts.parquet"]
    table = read_contacts(folder)
    assert table.integers("seed").tolist() == [0, 1, 2, 3] and table.origin == ORIGIN
    assert table.strings("state", "none").tolist() == ["none", "1-2-2", "none", "none"]
    touched = table.touched()
    assert touched.integers("seed").tolist() == [1, 2, 3]
    assert touched.numbers("wrench")[:, 5].tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(table.numbers("wrench")[0]).all() and np.isnan(table.numbers("travel_m")).all()
    assert table.numbers("n_z0")[1] == 0.25


def test_the_hash_is_of_the_rows_alone(tmp_path: Path) -> None:
    with ContactWriter(tmp_path / "one", ORIGIN) as one:
        one.put([row(2), row(1)])
    two = ContactWriter(tmp_path / "two", ORIGIN)
    two.put([row(1)])
    # a part that was joined and not yet removed
    two.put([row(1), row(2)])
    assert read_contacts(tmp_path / "one").sha256() == read_contacts(tmp_path / "two").sha256()


def test_other_settings_are_not_mixed_in(tmp_path: Path) -> None:
    with ContactWriter(tmp_path, ORIGIN) as writer:
        writer.put([row(1)])
    other = ORIGIN.model_copy(update={"settings": {"angle_rad": 0.2}})
    with pytest.raises(DatasetError, match="name another folder"):
        ContactWriter(tmp_path, other)


def test_what_is_no_data_set_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="collect"):
        read_contacts(tmp_path / "nothing")
    (tmp_path / "torn.parquet").write_bytes(b"PAR1 torn")
    with pytest.raises(DatasetError, match="cannot be read as Parquet"):
        read_contacts(tmp_path / "torn.parquet")
    pq.write_table(pa.table({"seed": [1]}), tmp_path / "other.parquet")
    with pytest.raises(DatasetError, match="no data set of contacts"):
        read_contacts(tmp_path / "other.parquet")


def test_the_documented_columns_are_the_columns() -> None:
    page = Path("docs/datasets.md").read_text(encoding="utf-8")
    for name, (length, kind, doc) in CONTACT_COLUMNS.items():
        shown = kind if length is None else f"{length} x {kind}"
        assert f"| `{name}` | {shown} | {doc.replace('|', chr(92) + '|')} |" in page
