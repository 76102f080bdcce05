"""Assemblies as a LeRobot dataset, format v3.0: joints, wrench, peg, pictures as video, phases, success."""
