"""The description of the cell: its file, a new one made by questions, its drivers, and its checks."""
