"""The cell in PyBullet."""
