"""The cell's devices on the bus: arm, force/torque sensor and stereo camera, simulated or real."""
