"""The camera's track: the pose of each frame."""
