"""`crosspih bench calibrations`: how well each calibration finds the hidden errors of simulated cells."""
