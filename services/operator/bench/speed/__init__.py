"""How long things take: starting, the bus, the recorder, the simulated cell, vision, a trial, many at once."""
