"""What is in a scene: the plate and its hole, surfaces, lights, and what stands around."""
