"""Other ends of devices, which speak their published protocols: for benches, tests, and whoever tries without them."""
