"""The commands of one assembly, one a file."""
