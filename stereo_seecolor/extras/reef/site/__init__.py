"""A fused run as a site: its mesh, its terrain, and the standard error of each cell of it."""
