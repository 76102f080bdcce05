"""The simulated cell: arm, sensor, cameras and hole in PyBullet, behind the same Protocols as real devices."""
