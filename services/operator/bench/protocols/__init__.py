"""Simulated devices that speak the published protocols of real ones: for benches, tests, and users without devices."""
