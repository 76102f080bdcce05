"""The commands of the speed benches, one a file."""
