"""What every crosspih service shares: geometry, shapes, the arm, the message contract, the bus, the service lifecycle."""
