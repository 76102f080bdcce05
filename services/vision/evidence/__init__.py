"""Decides whether a fit is a hole: the inside must lie deep, or the rim must have the chamfer of the drawing."""
