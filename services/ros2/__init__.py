"""The bridge to ROS 2: the cell's data go out as topics, and an assembly can be requested as a service or an action."""
