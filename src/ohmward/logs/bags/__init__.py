"""Recordings of ROS as tables: rosbag1, rosbag2 (SQLite and MCAP) and single MCAP files, whole or cut off."""
