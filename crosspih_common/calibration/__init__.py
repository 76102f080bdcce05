"""The parts of the guided calibrations that need no pictures: least squares with confidence intervals, and the fits of
stiffness, sensor mounting and tip. Pure functions: they read no clock, file or bus."""
