"""Input: folders, images, videos, bags, pairs and trajectories."""
