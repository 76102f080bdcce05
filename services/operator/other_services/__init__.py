"""Modules of other services, run as separate processes: services do not import each other."""
