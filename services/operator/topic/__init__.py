"""`crosspih topic`: the messages on the bus now, readable by anybody who may listen."""
