"""`crosspih bench caps`: how hard each kind of motion really presses a rigid plate, compared with the cap."""
