"""The services: each a process of its own, meeting the others on the bus alone."""
