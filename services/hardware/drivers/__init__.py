"""The drivers, by name; each in a file or folder of its own, imported only when asked for."""
