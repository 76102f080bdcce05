"""The commands that use devices through their protocols, one a file."""
