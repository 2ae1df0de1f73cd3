"""Folders, images, pairs and trajectories in."""
