"""A live WebSocket for Foxglove and Lichtblick: topics in their well-known schemas and in our own."""
