"""The command line itself: the table of its commands, and what they share in starting and in telling."""
