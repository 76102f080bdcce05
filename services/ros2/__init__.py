"""The bridge to ROS 2: what the cell says goes out as topics, and an assembly can be asked for as a service."""
