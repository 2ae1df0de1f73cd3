"""A fused run as a site: its mesh, its terrain, and how sure each cell of it is."""
