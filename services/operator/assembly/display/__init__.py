"""The terminal display while an assembly runs: the messages in order, and below them the current state."""
