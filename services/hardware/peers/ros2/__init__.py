"""The simulated cell behind ROS 2's topics: a ros2_control arm, its sensor and two cameras, without ROS."""
