"""Code of one's own, as docs/extending.md shows it: start the stack with this package's folder in PYTHONPATH."""
