"""What was recorded: looked into, mended, cut, merged, handed to other programs, and answered once more."""
