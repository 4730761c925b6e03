"""Recordings of ROS: folders of parts, SQLite parts, bags of ROS 1."""
