"""The commands of what is measured here, one a file."""
