"""`crosspih bench calibrations`: what each calibration finds of what simulated cells hide."""
