"""Cameras that show pictures from files: photos of a real cell, or pairs of another renderer, before a simulated arm."""
