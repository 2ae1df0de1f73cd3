"""Images of a run on its map's surface: the best view of each triangle, and texture pages."""
