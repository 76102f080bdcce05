"""The code that all services share: geometry, shapes, the arm, the messages, the bus, the service lifecycle."""
