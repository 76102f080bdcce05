"""`crosspih calibrate stereo|hand-eye|mount|stiffness|tcp|board`: guided; each names missing data and writes a file."""
