"""`crosspih calibrate`: one file a kind of measurement."""
