"""Messages of ROS 2, and their way out and in: rclpy where there is one, else zenoh as rmw_zenoh speaks it."""
