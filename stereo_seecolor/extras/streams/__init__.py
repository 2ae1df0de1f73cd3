"""Bags, videos of two cameras, live cameras and ROS 2 topics, and recordings of runs."""
