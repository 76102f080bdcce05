"""Devices' other ends: programs that speak a device's published protocol, for trying a driver without the device.

They stand in the hardware service because they may host the simulated cell's devices, which nobody else may import.
"""
