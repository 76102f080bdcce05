"""`crosspih dataset`, one file a command."""
