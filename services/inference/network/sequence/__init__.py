"""The sequence network: what the touches so far felt like, to a Gaussian over the hole's pose."""
