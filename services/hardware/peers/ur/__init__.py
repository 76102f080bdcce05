"""A Universal Robots controller on loopback: RTDE, dashboard and script ports, and the programs sent to them."""
