"""`crosspih view`."""
