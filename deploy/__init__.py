"""How the system is set up and run: the compose file, the pinned versions, the launcher."""
