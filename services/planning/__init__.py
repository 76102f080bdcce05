"""Where to move next: trajectories, and the assembly as a state machine."""
