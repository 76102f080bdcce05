"""`crosspih doctor`: whether an assembly could start, and if not, how to mend it."""
