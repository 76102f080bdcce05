"""`crosspih calibrate stereo|hand-eye|mount|stiffness|tcp|board`: guided, with what is missing and a file."""
