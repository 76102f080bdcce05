"""Peers that speak devices' published protocols over loopback: to try drivers without the devices, and to test them."""
