"""Trials side by side in cells of their own: what every bench of many assemblies runs on."""
