"""ROS bags as input, without ROS: two image topics become a dive of pairs."""
