"""What binds one device to its keys."""
