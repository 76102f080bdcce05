"""From raw sensor readings to contact: calibration, compensation, contact states."""
