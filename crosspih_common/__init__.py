"""What every crosspih service shares: geometry, shapes, the arm, the messages, the bus, the service lifecycle."""
