"""The cell in MuJoCo."""
