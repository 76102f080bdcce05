"""Measures the pose of the hole from a pair of stereo pictures."""
