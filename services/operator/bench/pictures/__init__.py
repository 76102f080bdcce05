"""Pictures that are not the cell's own: a physically based renderer, scenes of a workshop, and a sensor of our own."""
