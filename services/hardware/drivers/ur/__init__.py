"""Universal Robots by RTDE: the arm at its controller's own rate, and the sensor in its wrist."""
