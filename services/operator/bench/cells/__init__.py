"""Trials side by side, each in a cell of its own: used by every bench of many assemblies."""
