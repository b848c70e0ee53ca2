"""Messages of ROS 2, and their transport: rclpy if it is installed, otherwise zenoh in the format of rmw_zenoh."""
