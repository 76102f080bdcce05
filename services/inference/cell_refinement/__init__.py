"""A cell's drawing, F/T mounting and camera mounting refined over past recordings."""
