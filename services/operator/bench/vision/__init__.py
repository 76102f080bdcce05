"""`crosspih bench vision`: vision's pose of the hole against the truth."""
