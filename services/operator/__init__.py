"""The command line: start the cell, run assemblies, score them, look at what happened."""
