"""What a terminal shows while an assembly runs: the story as it is told, and below it how things stand."""
