"""`crosspih bench caps`: how hard every kind of motion truly presses a rigid plate, against the cap."""
