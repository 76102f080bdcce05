"""The command line itself: the table of its commands, and their shared code for starting and printing."""
