"""`crosspih topic`: what travels on the bus now, read by anybody who may listen."""
