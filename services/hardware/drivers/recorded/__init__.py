"""A recording of a cell played back as its devices: an arm and cameras that cannot be told anything new."""
