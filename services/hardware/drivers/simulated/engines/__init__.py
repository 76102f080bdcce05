"""The physics engines of the simulated cell, behind one protocol."""
