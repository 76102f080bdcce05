"""What the guided calibrations share and what needs no pictures: least squares with honest intervals, and the fits of
stiffness, sensor mounting and tip. Pure: nothing here reads a clock, a file or a bus."""
