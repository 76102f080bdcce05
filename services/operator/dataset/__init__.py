"""Contacts with known pose errors, collected in cells or made by the mechanics, as Parquet."""
