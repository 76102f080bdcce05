"""The simulated cell: thin devices over a physics engine, and a renderer."""
