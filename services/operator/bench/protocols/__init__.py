"""Devices that speak the published protocol of a real one: for benches, tests, and whoever tries without hardware."""
