"""Cameras that show pictures from files: photos of a real cell, or another renderer's, before a simulated arm."""
