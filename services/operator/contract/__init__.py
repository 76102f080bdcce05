"""The contract for programs in other languages: JSON Schema of every message, and an index from keys to schemas."""
