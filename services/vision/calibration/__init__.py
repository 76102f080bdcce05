"""Cameras calibrated by pictures of a ChArUco board: stereo, and where they stand by an arm that shows it."""
