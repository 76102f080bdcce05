"""Modules of other services run as processes beside this one: services do not import each other."""
