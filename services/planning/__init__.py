"""Motion planning: trajectories, and the assembly as a state machine."""
