"""From what the sensor reads to what contact does: calibration, compensation, contact states."""
