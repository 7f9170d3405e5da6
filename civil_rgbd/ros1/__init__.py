"""ROS 1 bags written without ROS: by the simulator, and for odometry engines."""
