"""Color charts and white cards: found in images, read, and scored."""
