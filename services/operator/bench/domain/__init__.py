"""`crosspih bench domain`: success over cells that differ from the default in one factor each."""
