"""Is it a hole at all: what is seen inside must lie deep, or the rim must have the drawing's chamfer."""
