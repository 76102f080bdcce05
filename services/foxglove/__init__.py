"""The cell for Foxglove and Lichtblick, live: a WebSocket of topics in their well-known schemas and of our own."""
