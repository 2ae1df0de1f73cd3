"""Markers on the bottom: found in the frames of a run, placed in its map, held against their known sizes and places."""
