"""The cell as it is described: which file it is, a new one made by questions, its drivers, and whether it holds."""
