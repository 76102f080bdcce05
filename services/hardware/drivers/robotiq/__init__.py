"""Robotiq FT 300 and FT 300-S: Modbus RTU or TCP, or the serial data stream."""
