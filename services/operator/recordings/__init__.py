"""Recordings: inspected, repaired, cut, merged, exported for other programs, and replayed."""
