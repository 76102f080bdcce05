"""Scenes as triangles, and the path tracer that renders them."""
