"""What the simulated cameras see."""
