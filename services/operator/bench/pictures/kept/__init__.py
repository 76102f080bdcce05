"""Which pictures there are, and how they are kept in files."""
