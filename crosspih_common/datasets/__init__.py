"""Data sets of contacts as Parquet: the operator collects them, inference makes and learns from them."""

from crosspih_common.datasets.contacts import (
    CONTACT,
    CONTACT_COLUMNS,
    SCHEMA_VERSION,
    ContactRow,
    ContactTable,
    ContactWriter,
    DatasetError,
    DatasetOrigin,
    read_contacts,
)

__all__ = [
    "CONTACT",
    "CONTACT_COLUMNS",
    "SCHEMA_VERSION",
    "ContactRow",
    "ContactTable",
    "ContactWriter",
    "DatasetError",
    "DatasetOrigin",
    "read_contacts",
]
