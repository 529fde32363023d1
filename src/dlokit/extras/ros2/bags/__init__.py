"""Bags of ROS 2 (rosbag2): read as recorded pictures, written as an export of a run."""
