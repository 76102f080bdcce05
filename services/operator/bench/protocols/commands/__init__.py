"""The commands that meet devices by their protocols, one a file."""
