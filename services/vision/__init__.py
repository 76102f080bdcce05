"""Where the hole is, from a stereo pair."""
