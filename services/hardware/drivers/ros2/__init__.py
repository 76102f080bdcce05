"""Devices that speak ROS 2: a ros2_control arm, a WrenchStamped topic, two image topics. No ROS is installed here."""
