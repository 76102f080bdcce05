"""Camera calibration from pictures of a ChArUco board: the stereo pair, and its pose in the base of an arm."""
