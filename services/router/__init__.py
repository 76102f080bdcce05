"""The Zenoh router that every other service is a client of."""
