"""The map's surface with the images on it: fewer triangles within a bound, each with its best view, seams leveled."""
